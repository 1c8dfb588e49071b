"""The town that stands still, ready for rays: meshes, their light, lamps of signals and streets."""

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore import EmbreeDevice
from embreex.rtcore_scene import EmbreeScene
from numpy.typing import NDArray

from shoot.world.looks import meshes, street_furniture, vehicles
from shoot.world.looks.houses import building
from shoot.world.looks.lamps import SIGNAL_LAMP_RADIUS_M, SIGNAL_LAMPS, STREET_LAMP
from shoot.world.looks.light import Light, lit
from shoot.world.looks.meshes import LAMP, Float32Array, Int32Array, Mesh
from shoot.world.town.town import FloatArray, Town
from shoot.world.traffic.recording import Recording

NO_OBJECT = -1
SIGNAL_RGB = np.array([[1.3, 0.03, 0.02], [1.25, 0.50, 0.02], [0.04, 1.15, 0.42]], np.float32)
# One for all scenes: a new one for each would cost as much as a small scene.
_DEVICE = EmbreeDevice()
_STREET_RGB = np.array([1.6, 1.25, 0.75], np.float32)


@dataclass(frozen=True)
class Solid:
    """Triangles with their light, in an Embree scene.

    Attributes:
        scene: What rays are cast into; None if there is no triangle.
        mesh: The triangles.
        normals: [F, 3].
        lit_rgb: [3, F] linear light they send out under sun and sky, or as lamps.
        albedo_rgb: [3, F] share of any further light they give back; 0 for lit lamps.
        object_of_face: [F] which parked car or agent, or `NO_OBJECT`.
    """

    scene: EmbreeScene | None
    mesh: Mesh
    normals: Float32Array
    lit_rgb: Float32Array
    albedo_rgb: Float32Array
    object_of_face: Int32Array


@dataclass(frozen=True)
class Lamps:
    """Lit lamps as points, for their glow.

    Attributes:
        points_m: [L, 3].
        facing: [L, 3] direction they shine; zero for all round.
        rgb: [L, 3] linear light.
        radius_m: [L].
    """

    points_m: FloatArray
    facing: FloatArray
    rgb: Float32Array
    radius_m: FloatArray


def embree_scene(mesh: Mesh) -> EmbreeScene | None:
    """Put a mesh into a new Embree scene; None for a mesh without triangles."""
    if len(mesh.faces) == 0:
        return None
    scene = EmbreeScene(_DEVICE)
    TriangleMesh(scene, np.ascontiguousarray(mesh.vertices_m), np.ascontiguousarray(mesh.faces))
    return scene


def no_solid() -> Solid:
    """Nothing for rays to meet."""
    none, planes = np.zeros((0, 3), np.float32), np.zeros((3, 0), np.float32)
    return Solid(None, meshes.join([]), none, planes, planes, np.zeros(0, np.int32))


def no_lamps() -> Lamps:
    """Darkness."""
    return Lamps(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros((0, 3), np.float32), np.zeros(0))


def join_lamps(first: Lamps, second: Lamps) -> Lamps:
    """All lamps of both."""
    return Lamps(
        np.concatenate([first.points_m, second.points_m]),
        np.concatenate([first.facing, second.facing]),
        np.concatenate([first.rgb, second.rgb]),
        np.concatenate([first.radius_m, second.radius_m]),
    )


def ego_pose(recording: Recording, time_s: float) -> tuple[float, float, float]:
    """Rear axle (x, y) in metres and heading in rad at a time, in the town's frame."""
    times_s = np.arange(len(recording.ego_yaw_rad)) * recording.dt_s
    x = float(np.interp(time_s, times_s, recording.ego_xy_m[:, 0]))
    y = float(np.interp(time_s, times_s, recording.ego_xy_m[:, 1]))
    return x, y, float(np.interp(time_s, times_s, recording.ego_yaw_rad))


class Scenery:
    """Everything of a town that stands still; parked car number i is object i.

    Attributes:
        solid: Its triangles; `set_signals` lights the lamps among them.
    """

    def __init__(self, town: Town, light: Light) -> None:
        self._light = light
        self.solid = _standing_solid(town, light)
        mesh = self.solid.mesh
        self._faces = np.flatnonzero((mesh.tag >= SIGNAL_LAMPS) & (mesh.material == LAMP))
        number = mesh.tag[self._faces] - SIGNAL_LAMPS
        self._signal, self._colour = number // 3, number % 3
        self._bright = SIGNAL_RGB[self._colour] * np.float32(light.lamp_gain)
        self._unlit = 0.03 * SIGNAL_RGB[self._colour] + mesh.rgb[self._faces]
        heads = [
            (index, head, lights.facing_rad)
            for index, lights in enumerate(town.signals)
            for head in lights.heads_m
        ]
        self._head_signal = np.array([index for index, _, _ in heads], np.int64)
        facing = np.array([angle for _, _, angle in heads], float)
        self._head_facing = np.stack([np.cos(facing), np.sin(facing), np.zeros(len(heads))], axis=1)
        lamps = [
            [street_furniture.signal_lamp_centre_m(h, a, c) for c in range(3)] for _, h, a in heads
        ]
        self._lamps_m = np.array(lamps, float).reshape(-1, 3, 3) + 0.05 * self._head_facing[:, None]
        posts = [thing for thing in town.props if thing.kind == "lamp_post"]
        tops = [np.array([*post.xy_m, post.height_m + 0.08]) for post in posts]
        self._posts_m = np.array(tops, float).reshape(-1, 3)

    def set_signals(self, state: NDArray[np.int64]) -> None:
        """Light the signal lamps that burn in a state ([signals]) and put out the others."""
        burns = (state[self._signal] == self._colour)[:, None]
        unlit = self._unlit * self._light.ambient_rgb
        self.solid.lit_rgb[:, self._faces] = np.where(burns, self._bright, unlit).T
        self.solid.albedo_rgb[:, self._faces] = np.where(burns, 0.0, self._unlit).T

    def lamps(self, state: NDArray[np.int64]) -> Lamps:
        """Lit lamps of signals and streets."""
        colour = state[self._head_signal]
        count = len(colour)
        signals = Lamps(
            self._lamps_m[np.arange(count), colour], self._head_facing,
            SIGNAL_RGB[colour], np.full(count, SIGNAL_LAMP_RADIUS_M),
        )  # fmt: skip
        if self._light.street_lamps <= 0.02:
            return signals
        num_posts = len(self._posts_m)
        posts = Lamps(
            self._posts_m, np.zeros((num_posts, 3)),
            np.tile(_STREET_RGB, (num_posts, 1)), np.full(num_posts, 0.25),
        )  # fmt: skip
        return join_lamps(signals, posts)


def _standing_solid(town: Town, light: Light) -> Solid:
    unlit = _unlit_solid(town)
    mesh = unlit.mesh
    lit_rgb, albedo = lit(mesh.rgb, unlit.normals, light).T.copy(), unlit.albedo_rgb.copy()
    if light.street_lamps > 0.02:
        burning = (mesh.material == LAMP) & (mesh.tag == STREET_LAMP)
        lit_rgb[:, burning], albedo[:, burning] = _STREET_RGB[:, None], 0.0
    return replace(unlit, lit_rgb=lit_rgb, albedo_rgb=albedo)


@lru_cache(maxsize=1)
def _unlit_solid(town: Town) -> Solid:
    """What stands, in the dark: the same for all scenes of a town, so not to be written to."""
    rng = np.random.default_rng([town.seed, 3])
    parts = [building(house, index) for index, house in enumerate(town.buildings)]
    parts += [street_furniture.prop(thing, rng) for thing in town.props]
    parts += [street_furniture.signal(lights, index) for index, lights in enumerate(town.signals)]
    owners = [NO_OBJECT] * len(parts)
    for index, parked in enumerate(town.parked_cars):
        length, width, height = (round(float(side), 3) for side in parked.size_m)
        shape = vehicles.car(length, width, height, parked.style)
        parts.append(shape.placed(parked.xy_m[0], parked.xy_m[1], parked.yaw_rad))
        owners.append(index)
    mesh = meshes.join(parts)
    counts = [len(part.faces) for part in parts]
    objects = np.repeat(np.asarray(owners, np.int32), np.asarray(counts, np.int64))
    albedo = mesh.rgb.T.copy()
    return Solid(embree_scene(mesh), mesh, mesh.normals(), np.zeros_like(albedo), albedo, objects)
