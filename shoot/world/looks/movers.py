"""Road users at any instant: where they are, and the meshes, shadows and lamps they then are."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from shoot.world.looks.lamps import HEAD_LAMP, HIGH_BRAKE_LAMP, TAIL_LAMP
from shoot.world.looks.light import Light, lit
from shoot.world.looks.meshes import LAMP, NO_TAG, SHADOW, Float32Array, Int32Array, Mesh
from shoot.world.looks.pedestrians import pedestrian
from shoot.world.looks.scenery import NO_OBJECT, Lamps, Solid, embree_scene, no_lamps, no_solid
from shoot.world.looks.vehicles import car, truck
from shoot.world.town.town import FloatArray
from shoot.world.traffic.recording import Recording

BRAKE_RGB = np.array([1.5, 0.05, 0.03], np.float32)
_TAIL_RGB = np.array([0.22, 0.008, 0.006], np.float32)
_HEAD_RGB = np.array([1.5, 1.45, 1.25], np.float32)
_WALKING_MPS = 0.2
# A shadow: the dark foot; a little lower, the foot again, the roof's shadow, what joins them.
_SHADOW_FACES = np.array(
    [[0, 1, 2], [0, 2, 3], [8, 9, 10], [8, 10, 11]]
    + [[4 + i, 4 + (i + 1) % 4, 8 + (i + 1) % 4] for i in range(4)]
    + [[4 + i, 8 + (i + 1) % 4, 8 + i] for i in range(4)],
    np.int32,
)


@dataclass(frozen=True)
class Moment:
    """The K road users present at one instant.

    Attributes:
        time_s: When.
        index: [K] place in `Recording.agents`.
        xy_m: [K, 2] centres of their boxes, in the town's frame.
        yaw_rad: [K].
        speed_mps: [K].
        is_braking: [K] whether brake lamps are lit.
        size_m: [K, 3] length, width, height.
        is_pedestrian: [K].
    """

    time_s: float
    index: NDArray[np.int64]
    xy_m: FloatArray
    yaw_rad: FloatArray
    speed_mps: FloatArray
    is_braking: NDArray[np.bool_]
    size_m: FloatArray
    is_pedestrian: NDArray[np.bool_]

    def select(self, chosen: NDArray[np.bool_]) -> "Moment":
        """Only the chosen ones ([K])."""
        return Moment(
            self.time_s, self.index[chosen], self.xy_m[chosen], self.yaw_rad[chosen],
            self.speed_mps[chosen], self.is_braking[chosen], self.size_m[chosen],
            self.is_pedestrian[chosen],
        )  # fmt: skip

    def within(self, eye_m: FloatArray, reach_m: float) -> "Moment":
        """Only those nearer than `reach_m` to a point (x, y, ...)."""
        return self.select(np.hypot(*(self.xy_m - eye_m[:2]).T) < reach_m)

    def corners_m(self, margin_m: float = 0.0) -> FloatArray:
        """Footprints [K, 4, 2], counter-clockwise from rear right."""
        half = self.size_m[:, None, :2] / 2 + margin_m
        local = half * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
        cos, sin = np.cos(self.yaw_rad)[:, None], np.sin(self.yaw_rad)[:, None]
        x = cos * local[..., 0] - sin * local[..., 1]
        y = sin * local[..., 0] + cos * local[..., 1]
        return np.asarray(np.stack([x, y], axis=-1) + self.xy_m[:, None], np.float64)


class Movers:
    """The road users of a recording, as arrays."""

    def __init__(self, recording: Recording) -> None:
        agents = recording.agents
        steps = len(recording.ego_yaw_rad)
        self._dt_s = recording.dt_s
        self._last = steps - 1
        self._agents = agents
        self._xy = np.array([a.xy_m for a in agents], float).reshape(len(agents), steps, 2)
        self._yaw = np.array([a.yaw_rad for a in agents], float).reshape(len(agents), steps)
        self._speed = np.array([a.speed_mps for a in agents], float).reshape(len(agents), steps)
        self._braking = np.array([a.is_braking for a in agents], bool).reshape(len(agents), steps)
        self._present = np.array([a.is_present for a in agents], bool).reshape(len(agents), steps)
        self._size = np.array([a.size_m for a in agents], float).reshape(len(agents), 3)
        self._pedestrian = np.array([a.kind == "pedestrian" for a in agents], bool)

    def at(self, time_s: float) -> Moment:
        """Everyone present at a time; between the recording's steps they go straight."""
        step = min(max(time_s / self._dt_s, 0.0), float(self._last))
        before = min(int(step), max(self._last - 1, 0))
        after, share = min(before + 1, self._last), step - before
        nearest = after if share >= 0.5 else before
        index = np.flatnonzero(self._present[:, before] & self._present[:, after])
        turn = self._yaw[index, after] - self._yaw[index, before]
        turn = (turn + np.pi) % (2 * np.pi) - np.pi
        return Moment(
            time_s,
            index,
            (1 - share) * self._xy[index, before] + share * self._xy[index, after],
            self._yaw[index, before] + share * turn,
            self._speed[index, nearest],
            self._braking[index, nearest],
            self._size[index],
            self._pedestrian[index],
        )

    def solid(
        self, moment: Moment, light: Light, first_object: int, with_shadows: bool = True
    ) -> Solid:
        """Meshes of everyone at a moment; agent k is object `first_object + k`."""
        if len(moment.index) == 0:
            return no_solid()
        shapes = [self._shape(moment, k) for k in range(len(moment.index))]
        num_faces = [len(shape.faces) for shape, _ in shapes]
        num_vertices = [len(shape.vertices_m) for shape, _ in shapes]
        of_vertex = np.repeat(np.arange(len(shapes)), num_vertices)
        of_face = np.repeat(np.arange(len(shapes)), num_faces)
        first_vertex = np.cumsum([0, *num_vertices[:-1]])
        local = np.concatenate([shape.vertices_m for shape, _ in shapes])
        vertices = _turned(local, moment.yaw_rad[of_vertex])
        vertices[:, :2] += moment.xy_m[of_vertex].astype(np.float32)
        faces = np.concatenate([shape.faces for shape, _ in shapes])
        faces = faces + first_vertex[of_face, None].astype(np.int32)
        normals = _turned(np.concatenate([n for _, n in shapes]), moment.yaw_rad[of_face])
        rgb = np.concatenate([shape.rgb for shape, _ in shapes])
        material = np.concatenate([shape.material for shape, _ in shapes])
        tag = np.concatenate([shape.tag for shape, _ in shapes])
        lit_rgb, albedo = lit(rgb, normals, light), rgb.copy()
        for lamps, colour in _lit_lamps(material == LAMP, tag, moment.is_braking[of_face], light):
            lit_rgb[lamps], albedo[lamps] = colour, 0.0
        owner = (first_object + moment.index[of_face]).astype(np.int32)
        mesh = Mesh(vertices, np.asarray(faces, np.int32), rgb, material, tag)
        if with_shadows:
            shadow, darkness = _shadows(moment, light)
            mesh = Mesh(
                np.concatenate([mesh.vertices_m, shadow.vertices_m]),
                np.concatenate([mesh.faces, shadow.faces + np.int32(len(vertices))]),
                np.concatenate([mesh.rgb, shadow.rgb]),
                np.concatenate([mesh.material, shadow.material]),
                np.concatenate([mesh.tag, shadow.tag]),
            )
            normals = np.concatenate(
                [normals, np.zeros_like(darkness) + np.array([0, 0, 1], np.float32)]
            )
            lit_rgb, albedo = (
                np.concatenate([lit_rgb, darkness]),
                np.concatenate([albedo, darkness]),
            )
            owner = np.concatenate([owner, np.full(len(darkness), NO_OBJECT, np.int32)])
        return Solid(embree_scene(mesh), mesh, normals, lit_rgb.T.copy(), albedo.T.copy(), owner)

    def lamps(self, moment: Moment, light: Light) -> Lamps:
        """Lit lamps of cars and lorries."""
        cars = moment.select(~moment.is_pedestrian)
        if len(cars.index) == 0:
            return no_lamps()
        ahead = np.stack(
            [np.cos(cars.yaw_rad), np.sin(cars.yaw_rad), np.zeros(len(cars.index))], axis=1
        )
        left = np.stack([-ahead[:, 1], ahead[:, 0], ahead[:, 2]], axis=1)
        length, width, height = (side[:, None] for side in cars.size_m.T)
        is_truck = np.array([self._agents[i].kind == "truck" for i in cars.index])[:, None]
        base = np.concatenate([cars.xy_m, np.where(is_truck, 0.78, 0.48 * height)], axis=1)
        groups = []
        for side in (-1, 1):
            middle = base + side * np.where(is_truck, 0.40, 0.37) * width * left
            front, rear = middle + (length / 2 + 0.05) * ahead, middle - (length / 2 + 0.05) * ahead
            on = cars.is_braking
            groups.append((rear[on], -ahead[on], BRAKE_RGB, 0.17))
            if light.are_lamps_lit:
                groups.append((rear[~on], -ahead[~on], _TAIL_RGB, 0.12))
                groups.append((front, ahead, _HEAD_RGB, 0.15))
        return Lamps(
            np.concatenate([points for points, _, _, _ in groups]),
            np.concatenate([facing for _, facing, _, _ in groups]),
            np.concatenate([np.tile(rgb, (len(points), 1)) for points, _, rgb, _ in groups]),
            np.concatenate([np.full(len(points), radius) for points, _, _, radius in groups]),
        )

    def _shape(self, moment: Moment, k: int) -> tuple[Mesh, Float32Array]:
        agent = self._agents[int(moment.index[k])]
        stride = 0
        if agent.kind == "pedestrian" and moment.speed_mps[k] > _WALKING_MPS:
            stride = (-1, 0, 1, 0)[int(moment.time_s * 5 + agent.style) % 4]
        length, width, height = (round(float(side), 3) for side in agent.size_m)
        return _model(agent.kind, length, width, height, agent.style, stride)


@lru_cache(maxsize=1024)
def _model(
    kind: str, length: float, width: float, height: float, style: int, stride: int
) -> tuple[Mesh, Float32Array]:
    """A model and its normals."""
    if kind == "pedestrian":
        shape = pedestrian(length, width, height, style, stride)
    elif kind == "truck":
        shape = truck(length, width, height, style)
    else:
        shape = car(length, width, height, style)
    return shape, shape.normals()


def _turned(points: Float32Array, yaw_rad: FloatArray) -> Float32Array:
    """Points or directions [P, 3], each turned by its own angle [P] about z."""
    cos, sin = np.cos(yaw_rad).astype(np.float32), np.sin(yaw_rad).astype(np.float32)
    turned = np.empty(points.shape, np.float32)
    turned[:, 0] = cos * points[:, 0] - sin * points[:, 1]
    turned[:, 1] = sin * points[:, 0] + cos * points[:, 1]
    turned[:, 2] = points[:, 2]
    return turned


def _lit_lamps(
    is_lamp: NDArray[np.bool_], tag: Int32Array, brakes: NDArray[np.bool_], light: Light
) -> list[tuple[NDArray[np.bool_], Float32Array]]:
    """Which faces are lit lamps, and their colours."""
    tail = is_lamp & (tag == TAIL_LAMP)
    high = is_lamp & (tag == HIGH_BRAKE_LAMP)
    groups = [((tail | high) & brakes, BRAKE_RGB * np.float32(light.lamp_gain))]
    if light.are_lamps_lit:
        groups.append((tail & ~brakes, _TAIL_RGB))
        groups.append((is_lamp & (tag == HEAD_LAMP), _HEAD_RGB))
    return groups


def _shadows(moment: Moment, light: Light) -> tuple[Mesh, Float32Array]:
    """Dark ground under and, in the sun, beside everyone; and its share of light, [F, 3]."""
    count = len(moment.index)
    foot = moment.corners_m(0.05)
    slide = np.zeros((count, 1, 2))
    if light.shadow < 0.9:
        flat = -light.sun_direction[:2] / max(float(light.sun_direction[2]), 0.25)
        slide = (0.8 * moment.size_m[:, 2:] * flat)[:, None]
    vertices = np.empty((count, 12, 3), np.float32)
    vertices[..., :2] = np.concatenate([foot, foot, foot + slide], axis=1)
    vertices[:, :4, 2], vertices[:, 4:, 2] = 0.02, 0.01
    faces = (_SHADOW_FACES + 12 * np.arange(count, dtype=np.int32)[:, None, None]).reshape(-1, 3)
    darkness = np.full((count, len(_SHADOW_FACES), 3), light.shadow, np.float32)
    darkness[:, :2] = np.where(moment.is_pedestrian, light.shadow, min(light.shadow, 0.3))[
        :, None, None
    ]
    flat_darkness = darkness.reshape(-1, 3)
    mesh = Mesh(
        vertices.reshape(-1, 3), np.asarray(faces, np.int32), flat_darkness,
        np.full(len(faces), SHADOW, np.uint8), np.full(len(faces), NO_TAG, np.int32),
    )  # fmt: skip
    return mesh, flat_darkness
