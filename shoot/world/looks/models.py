"""What things look like: cars, trucks, people, trees, lights and houses as meshes.

Movable things stand on z = 0 around the middle of their box, x forward, and stay inside the box
they are annotated with.
"""

from functools import lru_cache

import numpy as np

from shoot.world.looks import meshes
from shoot.world.looks.meshes import FACADE, GLASS, LAMP, NO_TAG, Float32Array, Mesh, linear_rgb
from shoot.world.town.town import Building, FloatArray, Prop, Signal

TAIL_LAMP, HEAD_LAMP, HIGH_BRAKE_LAMP, STREET_LAMP = 1, 2, 3, 4
SIGNAL_LAMPS = 100  # tag of a signal's lamp: SIGNAL_LAMPS + 3 * signal + colour
# Real lamps measure 0.2 to 0.3 m and would be lost in images of 200 pixels a row; ours are 0.42 m.
SIGNAL_LAMP_RADIUS_M = 0.21
SIGNAL_LAMP_STEP_M = 0.46

CAR_PAINT = tuple(
    linear_rgb(*rgb)
    for rgb in (
        (222, 222, 218), (48, 50, 56), (150, 154, 160), (176, 32, 36), (36, 72, 140),
        (206, 206, 210), (88, 92, 98), (34, 96, 82), (214, 168, 52),
        (120, 60, 44), (70, 130, 180), (236, 236, 236),
    )
)  # fmt: skip
COATS = tuple(
    linear_rgb(*rgb)
    for rgb in (
        (200, 60, 50), (60, 90, 170), (235, 235, 225), (50, 50, 55), (240, 190, 60), (90, 150, 90),
        (170, 90, 150), (120, 120, 130), (230, 130, 70), (70, 160, 170),
    )
)  # fmt: skip
TROUSERS = tuple(
    linear_rgb(*rgb)
    for rgb in ((40, 45, 70), (60, 55, 50), (30, 30, 32), (120, 110, 95), (75, 85, 110))
)
SKIN = tuple(
    linear_rgb(*rgb) for rgb in ((235, 200, 175), (205, 160, 125), (140, 95, 70), (95, 62, 45))
)
WALLS = tuple(
    linear_rgb(*rgb)
    for rgb in (
        (188, 120, 92), (214, 200, 172), (158, 150, 142), (196, 172, 130), (172, 92, 76),
        (206, 206, 200), (142, 128, 116), (220, 178, 140), (122, 134, 146), (180, 160, 150),
    )
)  # fmt: skip
_GLASS = linear_rgb(38, 46, 54)
_RUBBER = linear_rgb(26, 26, 28)
_STEEL = linear_rgb(92, 96, 98)
_DARK = linear_rgb(30, 32, 32)
_RED = linear_rgb(112, 14, 16)
_WHITE = linear_rgb(225, 225, 215)


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
        meshes.hexahedron(floor, floor, (0.12 * height, low), _DARK),
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
        parts.append(_end_quad(-x, (edges[0], edges[1]), z, _RED, LAMP, TAIL_LAMP))
        parts.append(
            _end_quad(
                x, (edges[0], edges[1]), (0.40 * height, 0.52 * height), _WHITE, LAMP, HEAD_LAMP
            )
        )
    parts.append(
        _end_quad(x, (-half * 0.45, half * 0.45), (0.26 * height, 0.42 * height), _DARK, 0, NO_TAG)
    )
    parts.append(_end_quad(-x, (-0.26, 0.26), (0.30 * height, 0.38 * height), _WHITE, 0, NO_TAG))
    brake_x = (rear + (roof_rear - rear) * 0.1) * length - 0.01
    parts.append(
        _end_quad(
            max(brake_x, -x),
            (-half * 0.3, half * 0.3),
            (belt, belt + 0.08),
            _RED,
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
        meshes.hexahedron(frame, frame, (0.45, 0.95), _DARK),
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
        parts.append(_end_quad(-x, (edges[0], edges[1]), (0.62, 0.94), _RED, LAMP, TAIL_LAMP))
        parts.append(_end_quad(x, (edges[0], edges[1]), (0.62, 0.86), _WHITE, LAMP, HEAD_LAMP))
    return meshes.join(parts)


@lru_cache(maxsize=512)
def pedestrian(length: float, width: float, height: float, style: int, stride: int) -> Mesh:
    """A person; `stride` -1, 0 or 1 is the leg in front."""
    coat, legs = COATS[style % len(COATS)], TROUSERS[(style // 3) % len(TROUSERS)]
    skin = SKIN[(style // 7) % len(SKIN)]
    half, depth = width / 2, length / 2
    hip, shoulder = 0.47 * height, 0.82 * height
    parts = []
    for side in (-1, 1):
        step = side * stride * 0.55 * depth
        y = side * 0.38 * half
        foot = (step - 0.09, step + 0.11, 0.09)
        leg = meshes.hexahedron(foot, (-0.09, 0.10, 0.10), (0.0, hip), legs)
        parts.append(leg.placed(0.0, y, 0.0))
        arm_x = -step * 0.8
        arm = meshes.hexahedron((arm_x - 0.06, arm_x + 0.06, 0.05), (-0.06, 0.06, 0.06),
                                (0.46 * height, shoulder - 0.03), coat * 0.85)  # fmt: skip
        parts.append(arm.placed(0.0, side * (half - 0.07), 0.0))
    waist, chest = min(0.13, depth * 0.6), min(0.15, depth * 0.7)
    parts.append(
        meshes.hexahedron(
            (-waist, waist, half * 0.62), (-chest, chest, half * 0.78), (hip - 0.04, shoulder), coat
        )
    )
    head_m = 0.078 * height
    parts.append(
        meshes.ball(
            (0.0, 0.0, height - 1.25 * head_m), (head_m, head_m * 0.85, head_m * 1.25), skin
        )
    )
    return meshes.join(parts)


def tree(prop: Prop, rng: np.random.Generator) -> Mesh:
    """Trunk and a crown of uneven balls, standing at its place."""
    x, y = (float(v) for v in prop.xy_m)
    green = linear_rgb(
        *((70, 104, 48), (88, 118, 54), (58, 92, 56), (112, 116, 52))[prop.style % 4]
    )
    crown = min(prop.radius_m, 0.36 * prop.height_m)
    middle = prop.height_m - crown
    parts = [
        meshes.tube((x, y, 0.0), (x, y, middle), (0.17, 0.11), linear_rgb(92, 74, 58)),
        meshes.ball((x, y, middle), crown, green, 1, 0.16, rng),
    ]
    for _ in range(2):
        dx, dy = rng.uniform(-0.45, 0.45, 2) * crown
        dz = rng.uniform(-0.35, 0.1) * crown
        parts.append(
            meshes.ball(
                (x + dx, y + dy, middle + dz),
                0.72 * crown,
                green * rng.uniform(0.8, 1.15),
                1,
                0.16,
                rng,
            )
        )
    return meshes.join(parts)


def prop(thing: Prop, rng: np.random.Generator) -> Mesh:
    """Tree, lamp post, bin or bush at its place."""
    x, y = (float(v) for v in thing.xy_m)
    if thing.kind == "tree":
        return tree(thing, rng)
    if thing.kind == "bush":
        size = (thing.radius_m, thing.radius_m, thing.height_m / 2)
        return meshes.ball((x, y, thing.height_m / 2), size, linear_rgb(74, 104, 56), 1, 0.14, rng)
    if thing.kind == "bin":
        colour = (linear_rgb(52, 84, 62), linear_rgb(70, 74, 84), linear_rgb(150, 120, 60))[
            thing.style % 3
        ]
        return meshes.tube((x, y, 0.0), (x, y, thing.height_m), thing.radius_m, colour)
    top = thing.height_m
    return meshes.join([
        meshes.tube((x, y, 0.0), (x, y, top - 0.15), (0.11, 0.07), _STEEL),
        meshes.tube((x, y, top - 0.3), (x, y, top), (0.16, 0.34), _WHITE, 6, LAMP, STREET_LAMP),
    ])  # fmt: skip


def signal_lamp_centre_m(head_m: FloatArray, facing_rad: float, colour: int) -> FloatArray:
    """Centre [3] of a lamp's glass; colour 0 (red) on top, 2 (green) at the bottom."""
    forward = np.array([np.cos(facing_rad), np.sin(facing_rad), 0.0])
    up = np.array([0.0, 0.0, (1 - colour) * SIGNAL_LAMP_STEP_M])
    return np.asarray(head_m + 0.16 * forward + up, np.float64)


def signal(lights: Signal, index: int) -> Mesh:
    """Poles, arms and heads of one approach; lamps are discs on the front, the back stays dark."""
    parts = []
    forward = np.array([np.cos(lights.facing_rad), np.sin(lights.facing_rad), 0.0])
    left = np.array([-forward[1], forward[0], 0.0])
    up = np.array([0.0, 0.0, 1.0])
    for head, foot in zip(lights.heads_m, lights.pole_feet_m, strict=True):
        case = meshes.box((0.0, 0.0, 0.0), (0.26, 0.56, 3 * SIGNAL_LAMP_STEP_M + 0.1), _DARK)
        parts.append(case.placed(head[0], head[1], lights.facing_rad, head[2]))
        top = float(head[2]) + 0.3
        parts.append(meshes.tube((foot[0], foot[1], 0.0), (foot[0], foot[1], top), 0.09, _STEEL))
        if np.hypot(*(head[:2] - foot)) > 0.3:
            behind = head - 0.2 * forward
            parts.append(
                meshes.tube(
                    (foot[0], foot[1], top - 0.1), (behind[0], behind[1], top - 0.1), 0.06, _STEEL
                )
            )
        for colour in range(3):
            centre = signal_lamp_centre_m(head, lights.facing_rad, colour) - 0.01 * forward
            turn = np.arange(10) * np.pi / 5
            ring = centre + SIGNAL_LAMP_RADIUS_M * (
                np.cos(turn)[:, None] * left + np.sin(turn)[:, None] * up
            )
            tag = SIGNAL_LAMPS + 3 * index + colour
            parts.append(meshes.polygon(ring.astype(np.float32), _DARK, LAMP, tag))
    return meshes.join(parts)


def building(house: Building, index: int) -> Mesh:
    """Walls (tagged with the building's index, windows come from shading) and a flat roof."""
    outline = np.asarray(house.outline_m, float)
    count = len(outline)
    low = np.column_stack([outline, np.full(count, 0.0)])
    high = np.column_stack([outline, np.full(count, house.height_m)])
    wall = WALLS[house.style % len(WALLS)]
    faces = []
    for i in range(count):
        j = (i + 1) % count
        faces += [[i, j, count + j], [i, count + j, count + i]]
    walls = meshes.build(np.concatenate([low, high]).astype(np.float32), faces, wall, FACADE, index)
    roof = meshes.polygon(high.astype(np.float32), linear_rgb(112, 104, 98))
    return meshes.join([walls, roof])
