"""What stands along roads, as meshes: trees, bushes, bins, lamp posts and traffic lights."""

import numpy as np

from shoot.world.looks import meshes
from shoot.world.looks.colours import DARK, STEEL, WHITE
from shoot.world.looks.lamps import (
    SIGNAL_LAMP_RADIUS_M,
    SIGNAL_LAMP_STEP_M,
    SIGNAL_LAMPS,
    STREET_LAMP,
)
from shoot.world.looks.meshes import LAMP, Mesh, linear_rgb
from shoot.world.town.town import FloatArray, Prop, Signal


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
        meshes.tube((x, y, 0.0), (x, y, top - 0.15), (0.11, 0.07), STEEL),
        meshes.tube((x, y, top - 0.3), (x, y, top), (0.16, 0.34), WHITE, 6, LAMP, STREET_LAMP),
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
        case = meshes.box((0.0, 0.0, 0.0), (0.26, 0.56, 3 * SIGNAL_LAMP_STEP_M + 0.1), DARK)
        parts.append(case.placed(head[0], head[1], lights.facing_rad, head[2]))
        top = float(head[2]) + 0.3
        parts.append(meshes.tube((foot[0], foot[1], 0.0), (foot[0], foot[1], top), 0.09, STEEL))
        if np.hypot(*(head[:2] - foot)) > 0.3:
            behind = head - 0.2 * forward
            parts.append(
                meshes.tube(
                    (foot[0], foot[1], top - 0.1), (behind[0], behind[1], top - 0.1), 0.06, STEEL
                )
            )
        for colour in range(3):
            centre = signal_lamp_centre_m(head, lights.facing_rad, colour) - 0.01 * forward
            turn = np.arange(10) * np.pi / 5
            ring = centre + SIGNAL_LAMP_RADIUS_M * (
                np.cos(turn)[:, None] * left + np.sin(turn)[:, None] * up
            )
            tag = SIGNAL_LAMPS + 3 * index + colour
            parts.append(meshes.polygon(ring.astype(np.float32), DARK, LAMP, tag))
    return meshes.join(parts)
