"""Triangle meshes with flat colours: the few solids everything in the city is built from."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

Float32Array = NDArray[np.float32]
Int32Array = NDArray[np.int32]

MATTE, FACADE, LAMP, SHADOW, GLASS = 0, 1, 2, 3, 4
NO_TAG = -1


def linear_rgb(red: int, green: int, blue: int) -> Float32Array:
    """Turn a display colour (0 to 255) into linear light (0 to 1), for a display gamma of 2."""
    return np.asarray(np.square([red, green, blue]) / 255.0**2, np.float32)


@dataclass(frozen=True)
class Mesh:
    """Triangles, each of one colour.

    Attributes:
        vertices_m: [V, 3].
        faces: [F, 3] indices into `vertices_m`, counter-clockwise seen from outside.
        rgb: [F, 3] share of light given back, linear; what a lamp emits when lit.
        material: [F] MATTE, FACADE (gets windows), LAMP, SHADOW (darkens the ground), GLASS.
        tag: [F] free for the owner: which lamp, which building; `NO_TAG` for none.
    """

    vertices_m: Float32Array
    faces: Int32Array
    rgb: Float32Array
    material: NDArray[np.uint8]
    tag: Int32Array

    def normals(self) -> Float32Array:
        """Unit normals [F, 3], outward."""
        corner = self.vertices_m[self.faces]
        normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
        length = np.linalg.norm(normal, axis=1, keepdims=True)
        return np.asarray(normal / np.maximum(length, 1e-12), np.float32)

    def placed(self, x_m: float, y_m: float, yaw_rad: float, z_m: float = 0.0) -> "Mesh":
        """The same mesh turned by `yaw_rad` about its own z axis, then moved."""
        return replace(self, vertices_m=place(self.vertices_m, x_m, y_m, yaw_rad, z_m))


def place(
    points_m: Float32Array, x_m: float, y_m: float, yaw_rad: float, z_m: float = 0.0
) -> Float32Array:
    """Turn points [V, 3] by `yaw_rad` about z, then move them."""
    cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
    turn = np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])
    return np.asarray(points_m @ turn + np.array([x_m, y_m, z_m]), np.float32)


def build(
    vertices: Sequence[Sequence[float]] | Float32Array,
    faces: Sequence[Sequence[int]] | Int32Array,
    rgb: Float32Array,
    material: int = MATTE,
    tag: int = NO_TAG,
) -> Mesh:
    """Make a mesh of one colour ([3]) or one colour a face ([F, 3]), material and tag."""
    index = np.asarray(faces, np.int32).reshape(-1, 3)
    count = len(index)
    return Mesh(
        np.asarray(vertices, np.float32),
        index,
        np.array(np.broadcast_to(rgb, (count, 3)), np.float32),
        np.full(count, material, np.uint8),
        np.full(count, tag, np.int32),
    )


def join(meshes: Sequence[Mesh]) -> Mesh:
    """Put meshes into one; an empty list gives a mesh without triangles."""
    if not meshes:
        return build(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int32), linear_rgb(0, 0, 0))
    starts = np.cumsum([0] + [len(mesh.vertices_m) for mesh in meshes[:-1]])
    return Mesh(
        np.concatenate([mesh.vertices_m for mesh in meshes]),
        np.concatenate([m.faces + np.int32(s) for m, s in zip(meshes, starts, strict=True)]),
        np.concatenate([mesh.rgb for mesh in meshes]),
        np.concatenate([mesh.material for mesh in meshes]),
        np.concatenate([mesh.tag for mesh in meshes]),
    )


_HEXAHEDRON = np.array(
    # bottom, top, then the four sides in the order of the corners 0-1, 1-2, 2-3, 3-0
    [
        *([0, 2, 1], [0, 3, 2], [4, 5, 6], [4, 6, 7]),
        *([0, 1, 5], [0, 5, 4], [1, 2, 6], [1, 6, 5], [2, 3, 7], [2, 7, 6], [3, 0, 4], [3, 4, 7]),
    ],
    np.int32,
)


def hexahedron(
    bottom: tuple[float, float, float],
    top: tuple[float, float, float],
    z_m: tuple[float, float],
    rgb: Float32Array,
    side_rgb: Float32Array | None = None,
    side_material: int = MATTE,
) -> Mesh:
    """A box whose lid may be smaller than its floor (car cabins, coats).

    Args:
        bottom: (rear x, front x, half width) of the floor.
        top: The same of the lid.
        z_m: Heights of floor and lid.
        rgb: Colour of floor and lid, and of the sides if they get none of their own.
        side_rgb: Colour of the four sides.
        side_material: Their material.
    """
    corners = [
        [x, y, z]
        for (rear, front, half), z in ((bottom, z_m[0]), (top, z_m[1]))
        for x, y in ((rear, -half), (front, -half), (front, half), (rear, half))
    ]
    mesh = build(corners, _HEXAHEDRON, rgb)
    if side_rgb is not None:
        mesh.rgb[4:] = side_rgb
    mesh.material[4:] = side_material
    return mesh


def box(
    centre: tuple[float, float, float],
    size: tuple[float, float, float],
    rgb: Float32Array,
    material: int = MATTE,
    tag: int = NO_TAG,
) -> Mesh:
    """An upright box around `centre`."""
    x, y, z = centre
    dx, dy, dz = (side / 2 for side in size)
    corners = [
        [x + sx * dx, y + sy * dy, z + sz * dz]
        for sz in (-1, 1)
        for sx, sy in ((-1, -1), (1, -1), (1, 1), (-1, 1))
    ]
    return build(corners, _HEXAHEDRON, rgb, material, tag)


def polygon(
    corners: Sequence[Sequence[float]] | Float32Array,
    rgb: Float32Array,
    material: int = MATTE,
    tag: int = NO_TAG,
) -> Mesh:
    """A flat convex polygon through `corners` ([P, 3])."""
    count = len(corners)
    return build(corners, [[0, i, i + 1] for i in range(1, count - 1)], rgb, material, tag)


def tube(
    start: Sequence[float],
    end: Sequence[float],
    radius_m: float | tuple[float, float],
    rgb: Float32Array,
    sides: int = 6,
    material: int = MATTE,
    tag: int = NO_TAG,
) -> Mesh:
    """A closed tube or cone between two points."""
    from_m, to_m = np.asarray(start, float), np.asarray(end, float)
    axis = (to_m - from_m) / np.linalg.norm(to_m - from_m)
    other = np.array([0.0, 0.0, 1.0]) if abs(axis[2]) < 0.9 else np.array([1.0, 0.0, 0.0])
    across = np.cross(axis, other)
    across /= np.linalg.norm(across)
    up = np.cross(axis, across)
    turn = np.arange(sides) * 2 * np.pi / sides
    ring = np.cos(turn)[:, None] * across + np.sin(turn)[:, None] * up
    first_m, last_m = (radius_m, radius_m) if isinstance(radius_m, float | int) else radius_m
    vertices = np.concatenate([from_m + first_m * ring, to_m + last_m * ring])
    faces = []
    for i in range(sides):
        j = (i + 1) % sides
        faces += [[i, j, sides + j], [i, sides + j, sides + i]]
    faces += [[0, i + 1, i] for i in range(1, sides - 1)]
    faces += [[sides, sides + i, sides + i + 1] for i in range(1, sides - 1)]
    return build(vertices.astype(np.float32), faces, rgb, material, tag)


def _icosahedron() -> tuple[Float32Array, Int32Array]:
    golden = (1 + 5**0.5) / 2
    vertices = np.array(
        [
            *([-1, golden, 0], [1, golden, 0], [-1, -golden, 0], [1, -golden, 0]),
            *([0, -1, golden], [0, 1, golden], [0, -1, -golden], [0, 1, -golden]),
            *([golden, 0, -1], [golden, 0, 1], [-golden, 0, -1], [-golden, 0, 1]),
        ]
    )
    faces = np.array(
        [
            *([0, 11, 5], [0, 5, 1], [0, 1, 7], [0, 7, 10], [0, 10, 11], [1, 5, 9], [5, 11, 4]),
            *([11, 10, 2], [10, 7, 6], [7, 1, 8], [3, 9, 4], [3, 4, 2], [3, 2, 6], [3, 6, 8]),
            *([3, 8, 9], [4, 9, 5], [2, 4, 11], [6, 2, 10], [8, 6, 7], [9, 8, 1]),
        ],
        np.int32,
    )
    return np.asarray(vertices / np.linalg.norm(vertices[0]), np.float32), faces


def _halved(vertices: Float32Array, faces: Int32Array) -> tuple[Float32Array, Int32Array]:
    """Split each triangle of a unit ball into four."""
    points = [tuple(vertex) for vertex in vertices.tolist()]
    middles: dict[tuple[int, int], int] = {}

    def middle(a: int, b: int) -> int:
        key = (min(a, b), max(a, b))
        if key not in middles:
            centre = np.add(points[a], points[b])
            points.append(tuple((centre / np.linalg.norm(centre)).tolist()))
            middles[key] = len(points) - 1
        return middles[key]

    split: list[list[int]] = []
    for a, b, c in faces.tolist():
        ab, bc, ca = middle(a, b), middle(b, c), middle(c, a)
        split += [[a, ab, ca], [b, bc, ab], [c, ca, bc], [ab, bc, ca]]
    return np.asarray(points, np.float32), np.asarray(split, np.int32)


_BALLS = [_icosahedron()]
_BALLS.append(_halved(*_BALLS[0]))


def ball(
    centre: Sequence[float],
    radius_m: float | Sequence[float],
    rgb: Float32Array,
    fineness: int = 0,
    roughness: float = 0.0,
    rng: np.random.Generator | None = None,
) -> Mesh:
    """A ball or ellipsoid; `roughness` makes its surface and colour uneven (foliage)."""
    vertices, faces = _BALLS[fineness]
    scaled = vertices * np.asarray(radius_m, np.float32)
    colours = np.broadcast_to(rgb, (len(faces), 3))
    if rng is not None and roughness > 0:
        scaled = scaled * rng.uniform(1 - roughness, 1 + roughness, (len(vertices), 1))
        colours = colours * rng.uniform(1 - 1.6 * roughness, 1 + 1.6 * roughness, (len(faces), 1))
    return build(
        np.asarray(scaled + np.asarray(centre), np.float32), faces, np.asarray(colours, np.float32)
    )
