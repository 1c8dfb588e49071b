"""People as meshes.

They stand on z = 0 around the middle of their box, x forward, and stay inside the box they are
annotated with.
"""

from functools import lru_cache

from shoot.world.looks import meshes
from shoot.world.looks.meshes import Mesh, linear_rgb

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
