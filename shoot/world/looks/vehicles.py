"""Cars and lorries as meshes.

They stand on z = 0 around the middle of their box, x forward, and stay inside the box they are
annotated with.
"""

from functools import lru_cache

import numpy as np

from shoot.world.looks import meshes
from shoot.world.looks.colours import DARK, RED, WHITE
from shoot.world.looks.lamps import HEAD_LAMP, HIGH_BRAKE_LAMP, TAIL_LAMP
from shoot.world.looks.meshes import GLASS, LAMP, NO_TAG, Float32Array, Mesh, linear_rgb

CAR_PAINT = tuple(
    linear_rgb(*rgb)
    for rgb in (
        (222, 222, 218), (48, 50, 56), (150, 154, 160), (176, 32, 36), (36, 72, 140),
        (206, 206, 210), (88, 92, 98), (34, 96, 82), (214, 168, 52),
        (120, 60, 44), (70, 130, 180), (236, 236, 236),
    )
)  # fmt: skip
_GLASS = linear_rgb(38, 46, 54)
_RUBBER = linear_rgb(26, 26, 28)


def _wheels(length: float, width: float, axle: float, radius: float) -> list[Mesh]:
    parts = []
    for x in (-axle, axle):
        for side in (-1, 1):
            outer, inner = side * width / 2, side * (width / 2 - 0.24)
            start, end = ((x, inner, radius), (x, outer, radius))
            parts.append(meshes.tube(start, end, radius, _RUBBER, sides=8))
            hub_m = 0.55 * radius
            parts.append(
                _side_disc(
                    x, side * (width / 2 + 0.0005), radius, hub_m, side, linear_rgb(120, 122, 126)
                )
            )
    return parts


def _side_disc(x: float, y: float, z: float, radius: float, side: int, rgb: Float32Array) -> Mesh:
    turn = side * -np.arange(6) * np.pi / 3
    ring = np.stack([x + radius * np.cos(turn), np.full(6, y), z + radius * np.sin(turn)], axis=1)
    return meshes.polygon(ring.astype(np.float32), rgb)


def _end_quad(
    x: float,
    y: tuple[float, float],
    z: tuple[float, float],
    rgb: Float32Array,
    material: int,
    tag: int,
) -> Mesh:
    """An upright rectangle across the car; faces backward where x is negative, else forward."""
    corners = [[x, y[0], z[0]], [x, y[1], z[0]], [x, y[1], z[1]], [x, y[0], z[1]]]
    return meshes.polygon(corners if x > 0 else corners[::-1], rgb, material, tag)


@lru_cache(maxsize=512)
def car(length: float, width: float, height: float, style: int) -> Mesh:
    """A saloon, hatchback or estate of the given size in metres; style picks shape and paint."""
    paint = CAR_PAINT[style % len(CAR_PAINT)]
    shape = (style // len(CAR_PAINT)) % 3
    # Where the cabin begins and ends at the belt line and at the roof, as shares of the length.
    rear, roof_rear, roof_front, front = (
        (-0.40, -0.24, 0.06, 0.24),
        (-0.47, -0.42, 0.06, 0.24),
        (-0.48, -0.44, 0.14, 0.30),
    )[shape]
    half, belt = width / 2, 0.60 * height
    low, end = 0.20 * height, length / 2
    floor = (-end * 0.97, end * 0.97, half * 0.9)
    bumpers = (-end + 0.01, end - 0.01, half * 0.99)
    parts = [
        # Sills and wheel arches in the dark under the body, then bumpers, then bonnet and boot.
        meshes.hexahedron(floor, floor, (0.12 * height, low), DARK),
        meshes.hexahedron(bumpers, bumpers, (low, 0.44 * height), paint),
        meshes.hexahedron(bumpers,
                          (-end * 0.97, end * 0.90, half * 0.93), (0.44 * height, belt), paint),
        meshes.hexahedron((rear * length, front * length, half * 0.92),
                          (roof_rear * length, roof_front * length, half * 0.76),
                          (belt, height), paint, _GLASS, GLASS),
    ]  # fmt: skip
    parts += _wheels(length, width, 0.30 * length, 0.22 * height)
    x = end - 0.002
    z = (0.42 * height, 0.56 * height)
    for side in (-1.0, 1.0):
        edges = sorted((side * half * 0.97, side * half * 0.52))
        parts.append(_end_quad(-x, (edges[0], edges[1]), z, RED, LAMP, TAIL_LAMP))
        parts.append(
            _end_quad(
                x, (edges[0], edges[1]), (0.40 * height, 0.52 * height), WHITE, LAMP, HEAD_LAMP
            )
        )
    parts.append(
        _end_quad(x, (-half * 0.45, half * 0.45), (0.26 * height, 0.42 * height), DARK, 0, NO_TAG)
    )
    parts.append(_end_quad(-x, (-0.26, 0.26), (0.30 * height, 0.38 * height), WHITE, 0, NO_TAG))
    brake_x = (rear + (roof_rear - rear) * 0.1) * length - 0.01
    parts.append(
        _end_quad(
            max(brake_x, -x),
            (-half * 0.3, half * 0.3),
            (belt, belt + 0.08),
            RED,
            LAMP,
            HIGH_BRAKE_LAMP,
        )
    )
    return meshes.join(parts)


@lru_cache(maxsize=128)
def truck(length: float, width: float, height: float, style: int) -> Mesh:
    """A lorry: cab in front, cargo box behind."""
    paint = CAR_PAINT[style % len(CAR_PAINT)]
    cargo = (linear_rgb(225, 225, 222), linear_rgb(196, 190, 176), linear_rgb(120, 150, 180))[
        style % 3
    ]
    half, end, cab = width / 2, length / 2, length / 2 - min(2.0, 0.28 * length)
    frame = (-end + 0.01, end - 0.05, half * 0.8)
    parts = [
        meshes.hexahedron(frame, frame, (0.45, 0.95), DARK),
        meshes.hexahedron((-end + 0.01, cab - 0.15, half), (-end + 0.01, cab - 0.15, half),
                          (0.95, height), cargo),
        meshes.hexahedron((cab, end - 0.01, half * 0.97), (cab, end - 0.01, half * 0.97),
                          (0.55, 0.52 * height), paint),
        meshes.hexahedron((cab, end - 0.01, half * 0.97), (cab, end - 0.25, half * 0.92),
                          (0.52 * height, 0.80 * height), paint, _GLASS, GLASS),
    ]  # fmt: skip
    parts += _wheels(length, width, 0.32 * length, 0.48)
    x = end - 0.002
    for side in (-1.0, 1.0):
        edges = sorted((side * half * 0.97, side * half * 0.62))
        parts.append(_end_quad(-x, (edges[0], edges[1]), (0.62, 0.94), RED, LAMP, TAIL_LAMP))
        parts.append(_end_quad(x, (edges[0], edges[1]), (0.62, 0.86), WHITE, LAMP, HEAD_LAMP))
    return meshes.join(parts)
