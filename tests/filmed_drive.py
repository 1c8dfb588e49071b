"""A drive that is known at every moment, and what cameras on the car see of its road.

The road lies on a plane that is tilted in the world, so that roll, pitch and yaw all differ from 0.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from lss_core.geometry import FloatArray, rigid_from_yaw

_STEP_S = 0.005


@dataclass(frozen=True)
class FilmedDrive:
    """A car that weaves along a slope.

    Attributes:
        seconds: How long it drives, from 0 s on.
        speed_mps: On average.
        bend_radpm: Curvature where it bends most.
        place_m: Where it starts, in the world.
    """

    seconds: float = 8.0
    speed_mps: float = 6.0
    bend_radpm: float = 0.03
    place_m: tuple[float, float, float] = (40.0, -25.0, 7.0)

    @cached_property
    def _path(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Times from before the drive to after it, places [T, 2] and headings in the plane."""
        time_s = np.arange(-1.0, self.seconds + 12.0, _STEP_S)
        speed = self.speed_mps * (1.0 + 0.3 * np.sin(0.4 * time_s))
        yaw = np.cumsum(self.bend_radpm * np.cos(0.9 * time_s) * speed * _STEP_S)
        steps = _STEP_S * speed[:, None] * np.stack([np.cos(yaw), np.sin(yaw)], axis=-1)
        return time_s, np.cumsum(steps, axis=0), yaw

    @cached_property
    def _tree(self) -> cKDTree:
        return cKDTree(self._path[1])

    @property
    def world_from_plane(self) -> FloatArray:
        """[4, 4]: z is across the slope, x where the car starts to drive."""
        tilt = np.eye(4)
        # Up by 0.04 to the front, by 0.03 to the left.
        tilt[:3, 0] = np.array([1.0, 0.0, 0.04]) / np.hypot(1.0, 0.04)
        left = np.array([0.0, 1.0, 0.03])
        left -= (left @ tilt[:3, 0]) * tilt[:3, 0]
        tilt[:3, 1] = left / np.linalg.norm(left)
        tilt[:3, 2] = np.cross(tilt[:3, 0], tilt[:3, 1])
        pose = rigid_from_yaw(np.zeros(2), 1.1) @ tilt
        pose[:3, 3] = self.place_m
        return pose

    def plane_from_ego(self, time_s: FloatArray | float) -> FloatArray:
        """[..., 4, 4] of the middle of the rear axle, on the road."""
        times, xy_m, yaw = self._path
        place = np.stack([np.interp(time_s, times, xy_m[:, axis]) for axis in range(2)], axis=-1)
        return rigid_from_yaw(place, np.interp(time_s, times, yaw))

    def world_from_ego(self, time_s: FloatArray | float) -> FloatArray:
        """[..., 4, 4], world being x east, y north, z up."""
        return self.world_from_plane @ self.plane_from_ego(time_s)

    def picture(
        self,
        rawpixel_from_camera: FloatArray,
        ego_from_camera: FloatArray,
        image_hw: tuple[int, int],
        time_s: float,
    ) -> NDArray[np.uint8]:
        """[H, W, 3] what a camera sees: a road of two lanes along the path, fields, sky."""
        v, u = np.indices(image_hw)
        pixels = np.stack([u, v, np.ones_like(u)], axis=-1).astype(float)
        rays = pixels @ (ego_from_camera[:3, :3] @ np.linalg.inv(rawpixel_from_camera)).T
        image = np.empty((*image_hw, 3), dtype=np.uint8)
        image[:] = (150, 190, 235)
        is_ground = rays[..., 2] < -0.005
        depth = -ego_from_camera[2, 3] / rays[is_ground][:, 2]
        ground = ego_from_camera[:2, 3] + depth[:, None] * rays[is_ground][:, :2]
        plane_from_ego = self.plane_from_ego(time_s)
        ground = ground @ plane_from_ego[:2, :2].T + plane_from_ego[:2, 3]
        off_m, row = self._tree.query(ground)
        times, xy_m, yaw = self._path
        to_side = ground - xy_m[row]
        left_m = np.where(
            np.cos(yaw[row]) * to_side[:, 1] - np.sin(yaw[row]) * to_side[:, 0] > 0.0, off_m, -off_m
        )
        checked = (np.floor(ground / 4.0).sum(axis=-1) % 2 == 0)[:, None]
        colour = np.where(checked, [[96, 130, 70]], [[110, 145, 84]])
        # The car drives in the right one of two lanes of 3.5 m.
        is_road = (left_m > -1.75) & (left_m < 5.25)
        colour[is_road] = (95, 95, 98)
        along = times[row] * self.speed_mps
        is_paint = (np.abs(left_m + 1.65) < 0.1) | (np.abs(left_m - 5.15) < 0.1)
        is_paint |= (np.abs(left_m - 1.75) < 0.08) & (along % 6.0 < 3.0)
        colour[is_paint] = (235, 235, 230)
        image[is_ground] = colour
        return image
