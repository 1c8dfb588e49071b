"""Houses as meshes."""

import numpy as np

from shoot.world.looks import meshes
from shoot.world.looks.meshes import FACADE, Mesh, linear_rgb
from shoot.world.town.town import Building

WALLS = tuple(
    linear_rgb(*rgb)
    for rgb in (
        (188, 120, 92), (214, 200, 172), (158, 150, 142), (196, 172, 130), (172, 92, 76),
        (206, 206, 200), (142, 128, 116), (220, 178, 140), (122, 134, 146), (180, 160, 150),
    )
)  # fmt: skip


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
