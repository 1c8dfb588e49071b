"""Windows on walls, from where on the wall a ray arrives."""

import numpy as np

from shoot.world.looks.light import Light
from shoot.world.looks.meshes import FACADE, Float32Array, Int32Array
from shoot.world.looks.scenery import Solid
from shoot.world.town.town import Town

# By style: distance between windows and floors in metres, a window's share of each.
_STEP_M = np.array([2.6, 3.4, 1.9, 4.2], np.float32)
_FLOOR_M = np.array([3.1, 3.4, 3.2, 3.6], np.float32)
_WIDE = np.array([0.46, 0.62, 0.56, 0.80], np.float32)
_TALL = np.array([0.50, 0.56, 0.66, 0.46], np.float32)
_SHOP_WIDE, _SHOP_TALL = np.float32(0.80), np.float32(0.66)


class Facades:
    """Window grids of a town's walls, one row of numbers a face."""

    def __init__(self, solid: Solid, town: Town) -> None:
        normals, mesh = solid.normals, solid.mesh
        walls = np.flatnonzero(mesh.material == FACADE)
        self._row = np.zeros(len(mesh.faces), np.int32)
        self._row[walls] = np.arange(len(walls))
        tangent = np.stack([-normals[walls, 1], normals[walls, 0]], axis=1)
        along = np.einsum("fvx,fx->fv", mesh.vertices_m[mesh.faces[walls]][:, :, :2], tangent)
        start = along.min(axis=1)
        length = np.maximum(along.max(axis=1) - start, 1.0)
        house = mesh.tag[walls]
        style = np.array([b.style for b in town.buildings] or [0], np.int64)[house] % 4
        height = np.array([b.height_m for b in town.buildings] or [0.0], np.float32)[house]
        step = length / np.maximum(np.floor(length / _STEP_M[style]), 1)
        floors = np.floor((height - 0.5) / _FLOOR_M[style])
        side = (tangent[:, 0] * 8).astype(np.int64) % 64
        key = (house.astype(np.int64) * 1299709 + side * 15485863) % 65536
        self._table = np.ascontiguousarray(
            np.stack([
                tangent[:, 0] / step, tangent[:, 1] / step, start / step, 1 / step,
                1 / _FLOOR_M[style],
                _WIDE[style] / 2, _TALL[style] / 2, floors, key,
            ]).astype(np.float32)
        )  # fmt: skip

    def colours(
        self,
        points_m: Float32Array,
        face: Int32Array,
        wall_rgb: Float32Array,
        pixel_m: Float32Array,
        light: Light,
    ) -> Float32Array:
        """Wall or window colours of points on walls; far windows melt into their mean.

        Args:
            points_m: [3, P] on the walls.
            face: [P] face of the solid each lies on.
            wall_rgb: [3, P] linear light of the bare wall.
            pixel_m: [P] size of a pixel there.
            light: Of the scene.

        Returns:
            [3, P].
        """
        row = self._row[face]
        along_x, along_y, start, per_step, per_floor, wide, tall, floors, key = (
            column[row] for column in self._table
        )
        column = points_m[0] * along_x + points_m[1] * along_y - start
        storey = points_m[2] * per_floor
        column_number, storey_number = np.floor(column), np.floor(storey)
        is_shop = storey_number < 1
        half_w = np.where(is_shop, _SHOP_WIDE / 2, wide)
        half_h = np.where(is_shop, _SHOP_TALL / 2, tall)
        soft_x = np.maximum(pixel_m * per_step, np.float32(0.01))
        soft_y = np.maximum(pixel_m * per_floor, np.float32(0.01))
        dx = np.abs(column - column_number - np.float32(0.5))
        dy = np.abs(storey - storey_number - np.float32(0.52))
        cover = _share((half_w - dx) / soft_x) * _share((half_h - dy) / soft_y)
        # A mullion down the middle of wide panes, a sill-high rail across shop windows.
        cover *= _share((dx - np.float32(0.02)) / soft_x)
        melt = np.clip(2 * np.maximum(soft_x, soft_y) - np.float32(0.5), 0, 1)
        cover += melt * (4 * half_w * half_h - cover)
        cover *= storey_number < floors
        number = column_number * np.float32(79) + storey_number * np.float32(131) + key
        luck = np.mod(number * np.float32(0.754877), 1).astype(np.float32)
        luck = np.mod(luck * np.float32(57.31), 1).astype(np.float32)
        pane = (np.float32(0.07) + np.float32(0.22) * luck) * light.horizon_rgb[:, None]
        pane += np.float32(0.02) * light.ambient_rgb[:, None]
        if light.lit_windows > 0:
            glow = np.float32(0.28) + np.float32(0.5) * np.mod(luck * 7, 1)
            glow *= luck < light.lit_windows
            pane += np.array([0.75, 0.55, 0.28], np.float32)[:, None] * glow
        return np.asarray(wall_rgb + cover * (pane - wall_rgb), np.float32)


def _share(edges: Float32Array) -> Float32Array:
    """Share of a pixel inside an edge that is `edges` pixels away (positive: inside)."""
    return np.asarray(np.clip(edges + np.float32(0.5), 0, 1), np.float32)
