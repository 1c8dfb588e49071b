"""Meshes ready for rays: the town that stands still, and at any instant what moves through it."""

from dataclasses import dataclass

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from numpy.typing import NDArray

from shoot.world import meshes, models
from shoot.world.ground import footprint
from shoot.world.light import Light, lit
from shoot.world.meshes import LAMP, SHADOW, Float32Array, Int32Array, Mesh, linear_rgb
from shoot.world.recording import Agent, Recording
from shoot.world.town import FloatArray, Town

NO_OBJECT = -1
SIGNAL_RGB = np.array([[1.3, 0.03, 0.02], [1.25, 0.50, 0.02], [0.04, 1.15, 0.42]], np.float32)
_BRAKE_RGB = np.array([1.5, 0.05, 0.03], np.float32)
_TAIL_RGB = np.array([0.22, 0.008, 0.006], np.float32)
_HEAD_RGB = np.array([1.5, 1.45, 1.25], np.float32)
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


@dataclass(frozen=True)
class AgentPose:
    """Where an agent is at one instant.

    Attributes:
        index: Its place in `Recording.agents`.
        agent: The agent.
        xy_m: [2] centre of its box, in the town's frame.
        yaw_rad: Heading.
        speed_mps: Speed.
        is_braking: Whether its brake lamps are lit.
    """

    index: int
    agent: Agent
    xy_m: FloatArray
    yaw_rad: float
    speed_mps: float
    is_braking: bool


def embree_scene(mesh: Mesh) -> EmbreeScene | None:
    """Put a mesh into a new Embree scene; None for a mesh without triangles."""
    if len(mesh.faces) == 0:
        return None
    scene = EmbreeScene()
    TriangleMesh(scene, np.ascontiguousarray(mesh.vertices_m), np.ascontiguousarray(mesh.faces))
    return scene


def ego_pose(recording: Recording, time_s: float) -> tuple[float, float, float]:
    """Rear axle (x, y) in metres and heading in rad at a time, in the town's frame."""
    times_s = np.arange(len(recording.ego_yaw_rad)) * recording.dt_s
    x = float(np.interp(time_s, times_s, recording.ego_xy_m[:, 0]))
    y = float(np.interp(time_s, times_s, recording.ego_xy_m[:, 1]))
    return x, y, float(np.interp(time_s, times_s, recording.ego_yaw_rad))


def agent_poses(recording: Recording, time_s: float) -> list[AgentPose]:
    """All agents present at a time, between the recording's steps in a straight line."""
    last = len(recording.ego_yaw_rad) - 1
    step = min(max(time_s / recording.dt_s, 0.0), float(last))
    before = min(int(step), max(last - 1, 0))
    after, share = min(before + 1, last), step - before
    poses = []
    for index, agent in enumerate(recording.agents):
        if not (agent.is_present[before] and agent.is_present[after]):
            continue
        xy_m = (1 - share) * agent.xy_m[before] + share * agent.xy_m[after]
        turn = agent.yaw_rad[after] - agent.yaw_rad[before]
        turn = (turn + np.pi) % (2 * np.pi) - np.pi
        nearest = after if share >= 0.5 else before
        poses.append(
            AgentPose(
                index,
                agent,
                xy_m,
                float(agent.yaw_rad[before] + share * turn),
                float(agent.speed_mps[nearest]),
                bool(agent.is_braking[nearest]),
            )  # fmt: skip
        )
    return poses


def standing_solid(town: Town, light: Light) -> Solid:
    """Everything of a town that stands still; parked car number i is object i."""
    rng = np.random.default_rng([town.seed, 3])
    parts = [models.building(house, index) for index, house in enumerate(town.buildings)]
    parts += [models.prop(thing, rng) for thing in town.props]
    parts += [models.signal(lights, index) for index, lights in enumerate(town.signals)]
    owners = [NO_OBJECT] * len(parts)
    for index, parked in enumerate(town.parked_cars):
        shape = models.car(*(round(float(side), 3) for side in parked.size_m), parked.style)
        parts.append(shape.placed(parked.xy_m[0], parked.xy_m[1], parked.yaw_rad))
        owners.append(index)
    mesh = meshes.join(parts)
    counts = [len(part.faces) for part in parts]
    normals = mesh.normals()
    solid = Solid(
        embree_scene(mesh), mesh, normals, lit(mesh.rgb, normals, light).T.copy(), mesh.rgb.T.copy(),
        np.repeat(np.asarray(owners, np.int32), counts),
    )  # fmt: skip
    burning = (
        (mesh.material == LAMP) & (mesh.tag == models.STREET_LAMP) & (light.street_lamps > 0.02)
    )
    solid.lit_rgb[:, burning] = _STREET_RGB[:, None]
    solid.albedo_rgb[:, burning] = 0.0
    return solid


def light_signals(solid: Solid, state: NDArray[np.int64], light: Light) -> None:
    """Light the lamps that burn now and put out the others, in place (a town has thousands of faces)."""
    is_lamp = (solid.mesh.tag >= models.SIGNAL_LAMPS) & (solid.mesh.material == LAMP)
    faces = np.flatnonzero(is_lamp)
    number = solid.mesh.tag[faces] - models.SIGNAL_LAMPS
    colour = number % 3
    burns = state[number // 3] == colour
    dark = 0.03 * SIGNAL_RGB[colour] + solid.mesh.rgb[faces]
    bright = SIGNAL_RGB[colour] * np.float32(light.lamp_gain)
    solid.lit_rgb[:, faces] = np.where(burns[:, None], bright, dark * light.ambient_rgb).T
    solid.albedo_rgb[:, faces] = np.where(burns[:, None], 0.0, dark).T


def _agent_mesh(pose: AgentPose, time_s: float) -> Mesh:
    length, width, height = (round(float(side), 3) for side in pose.agent.size_m)
    if pose.agent.kind == "pedestrian":
        stride = (
            (-1, 0, 1, 0)[int(time_s * 5 + pose.agent.style) % 4] if pose.speed_mps > 0.2 else 0
        )
        return models.pedestrian(length, width, height, pose.agent.style, stride)
    build = models.truck if pose.agent.kind == "truck" else models.car
    return build(length, width, height, pose.agent.style)


def _shadow(pose: AgentPose, light: Light) -> list[Mesh]:
    """Dark ground around and, in the sun, beside an agent."""
    base = footprint(pose.xy_m, pose.yaw_rad, pose.agent.size_m + 0.1)
    shapes = [(base, min(light.shadow, 0.3) if pose.agent.kind != "pedestrian" else light.shadow)]
    if light.shadow < 0.9:
        slide = -light.sun_direction[:2] / max(float(light.sun_direction[2]), 0.25)
        cast = base + slide * 0.8 * pose.agent.size_m[2]
        middle = np.concatenate([base, cast])
        hull = middle[_hull_order(middle)]
        shapes.append((hull, light.shadow))
    parts = []
    for layer, (outline, darkness) in enumerate(shapes):
        # The darker, smaller one lies on top.
        height = 0.02 - 0.01 * layer
        corners = np.column_stack([outline, np.full(len(outline), height)]).astype(np.float32)
        parts.append(meshes.polygon(corners, np.full(3, darkness, np.float32), SHADOW))
    return parts


def _hull_order(points: FloatArray) -> list[int]:
    """Indices of the convex hull of a few points, counter-clockwise (Andrew's chains)."""
    order = sorted(range(len(points)), key=lambda i: (points[i][0], points[i][1]))
    chains: list[int] = []
    for sequence in (order, order[::-1]):
        chain: list[int] = []
        for i in sequence:
            while len(chain) >= 2:
                a, b = points[chain[-2]], points[chain[-1]]
                if (b[0] - a[0]) * (points[i][1] - a[1]) > (b[1] - a[1]) * (points[i][0] - a[0]):
                    break
                chain.pop()
            chain.append(i)
        chains += chain[:-1]
    return chains


def moving_solid(
    poses: list[AgentPose],
    time_s: float,
    light: Light,
    first_object: int,
    with_shadows: bool = True,
) -> Solid:
    """Agents as they stand at an instant; agent k is object `first_object + k`."""
    parts: list[Mesh] = []
    lights: list[Float32Array] = []
    albedos: list[Float32Array] = []
    owners: list[int] = []
    for pose in poses:
        shape = _agent_mesh(pose, time_s)
        cos, sin = np.cos(pose.yaw_rad), np.sin(pose.yaw_rad)
        turn = np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])
        shine = lit(shape.rgb, _own_normals(shape), light, turn @ light.sun_direction)
        albedo = shape.rgb.copy()
        if pose.agent.kind != "pedestrian":
            _light_car(shape, pose.is_braking, light, shine, albedo)
        parts.append(shape.placed(pose.xy_m[0], pose.xy_m[1], pose.yaw_rad))
        lights.append(shine)
        albedos.append(albedo)
        owners.append(first_object + pose.index)
        for shadow in _shadow(pose, light) if with_shadows else []:
            parts.append(shadow)
            lights.append(shadow.rgb)
            albedos.append(shadow.rgb)
            owners.append(NO_OBJECT)
    mesh = meshes.join(parts)
    counts = [len(part.faces) for part in parts]
    empty = np.zeros((0, 3), np.float32)
    return Solid(
        embree_scene(mesh), mesh, mesh.normals(), np.concatenate([empty, *lights]).T.copy(),
        np.concatenate([empty, *albedos]).T.copy(), np.repeat(np.asarray(owners, np.int32), counts),
    )  # fmt: skip


_NORMALS: dict[int, tuple[Mesh, Float32Array]] = {}


def _own_normals(shape: Mesh) -> Float32Array:
    """Normals of a model, kept as long as the model (models are few and shared)."""
    key = id(shape)
    if key not in _NORMALS or _NORMALS[key][0] is not shape:
        if len(_NORMALS) > 1024:
            _NORMALS.clear()
        _NORMALS[key] = (shape, shape.normals())
    return _NORMALS[key][1]


def _light_car(
    shape: Mesh, is_braking: bool, light: Light, shine: Float32Array, albedo: Float32Array
) -> None:
    lamp = shape.material == LAMP
    tail = lamp & (shape.tag == models.TAIL_LAMP)
    if is_braking:
        tail |= lamp & (shape.tag == models.HIGH_BRAKE_LAMP)
        shine[tail], albedo[tail] = _BRAKE_RGB * light.lamp_gain, 0.0
    elif light.are_lamps_lit:
        shine[tail], albedo[tail] = _TAIL_RGB, 0.0
    if light.are_lamps_lit:
        head = lamp & (shape.tag == models.HEAD_LAMP)
        shine[head], albedo[head] = _HEAD_RGB, 0.0


def burning_lamps(
    town: Town, state: NDArray[np.int64], poses: list[AgentPose], light: Light
) -> Lamps:
    """All lamps that are lit now: signals, brake, tail and head lamps, street lamps."""
    points: list[FloatArray] = []
    facing: list[FloatArray] = []
    rgb: list[Float32Array] = []
    radius: list[float] = []

    def add(point: FloatArray, towards: FloatArray, colour: Float32Array, size_m: float) -> None:
        points.append(point)
        facing.append(towards)
        rgb.append(colour * np.float32(light.lamp_gain))
        radius.append(size_m)

    for lights, colour in zip(town.signals, state.tolist(), strict=True):
        ahead = np.array([np.cos(lights.facing_rad), np.sin(lights.facing_rad), 0.0])
        for head in lights.heads_m:
            centre = models.signal_lamp_centre_m(head, lights.facing_rad, colour)
            add(centre + 0.05 * ahead, ahead, SIGNAL_RGB[colour], models.SIGNAL_LAMP_RADIUS_M)
    for pose in poses:
        if pose.agent.kind == "pedestrian":
            continue
        length, width, height = pose.agent.size_m
        ahead = np.array([np.cos(pose.yaw_rad), np.sin(pose.yaw_rad), 0.0])
        left = np.array([-ahead[1], ahead[0], 0.0])
        middle = np.array([pose.xy_m[0], pose.xy_m[1], 0.0])
        share = 0.30 if pose.agent.kind == "truck" else 0.48
        for side in (-1, 1):
            base = middle + side * 0.37 * width * left + share * height * np.array([0.0, 0.0, 1.0])
            back, front = base - (length / 2 + 0.05) * ahead, base + (length / 2 + 0.05) * ahead
            if pose.is_braking:
                add(back, -ahead, _BRAKE_RGB, 0.17)
            elif light.are_lamps_lit:
                add(back, -ahead, _TAIL_RGB, 0.12)
            if light.are_lamps_lit:
                add(front, ahead, _HEAD_RGB, 0.15)
    if light.street_lamps > 0.02:
        for thing in town.props:
            if thing.kind == "lamp_post":
                add(np.array([*thing.xy_m, thing.height_m + 0.08]), np.zeros(3), _STREET_RGB, 0.25)
    return Lamps(
        np.asarray(points).reshape(-1, 3), np.asarray(facing).reshape(-1, 3),
        np.asarray(rgb, np.float32).reshape(-1, 3), np.asarray(radius),
    )  # fmt: skip
