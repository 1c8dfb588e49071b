"""One camera at one instant, and what it may see of those who move."""

from dataclasses import dataclass

import numpy as np

from shoot.world.looks.light import Light
from shoot.world.looks.meshes import Int32Array
from shoot.world.looks.movers import Moment
from shoot.world.sensing.rig import Camera
from shoot.world.town.town import FloatArray
from shoot.world.traffic.recording import AGENT_SIGHT_M


@dataclass(frozen=True)
class View:
    """One camera at one instant, in the town's frame.

    Attributes:
        camera: The camera.
        eye_m: [3] its optical centre.
        town_from_camera: [3, 3] its directions.
        ego_xy_m, ego_yaw_rad: The car then.
    """

    camera: Camera
    eye_m: FloatArray
    town_from_camera: FloatArray
    ego_xy_m: FloatArray
    ego_yaw_rad: float

    def project(self, points_m: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Pixel coordinates u, v and depth of points [P, 3]; only depths above 0 lie ahead."""
        seen = (points_m - self.eye_m) @ self.town_from_camera
        depth = np.maximum(seen[:, 2], 1e-3)
        k = self.camera.pixel_from_camera
        return (
            k[0, 0] * seen[:, 0] / depth + k[0, 2],
            k[1, 1] * seen[:, 1] / depth + k[1, 2],
            seen[:, 2],
        )


def in_sight(moment: Moment, view: View, light: Light) -> tuple[Moment, Int32Array]:
    """Agents that may be in the picture, and the pixels they and their shadows may cover.

    Args:
        moment: Where everybody is.
        view: The camera.
        light: For how far shadows reach.

    Returns:
        Those agents, and numbers of pixels, row by row.
    """
    camera = view.camera
    mask = np.zeros((camera.height_px, camera.width_px), bool)
    moment = moment.within(view.eye_m, AGENT_SIGHT_M)
    if len(moment.index) == 0:
        return moment, np.zeros(0, np.int32)
    sun = light.sun_direction
    cast_m = 0.0 if light.shadow >= 0.9 else 0.8 / max(float(sun[2]), 0.25)
    places, sizes = moment.xy_m, moment.size_m
    radius = np.hypot(sizes[:, 0], sizes[:, 1]) / 2 + 0.2
    square = np.array([[-1.0, -1.0], [-1.0, 1.0], [1.0, -1.0], [1.0, 1.0]])
    corners = np.zeros((len(sizes), 12, 3))
    corners[..., :2] = (places[:, None] + radius[:, None, None] * square)[:, [0, 1, 2, 3] * 3]
    corners[:, 4:8, 2] = sizes[:, 2:]
    corners[:, 8:, :2] -= (cast_m * sizes[:, 2:] * sun[:2])[:, None]
    seen = (corners - view.eye_m) @ view.town_from_camera
    k = camera.pixel_from_camera
    depth = np.maximum(seen[..., 2], 0.3)
    u = k[0, 0] * seen[..., 0] / depth + k[0, 2]
    v = k[1, 1] * seen[..., 1] / depth + k[1, 2]
    left, right = u.min(axis=1) - 1, u.max(axis=1) + 3
    top, bottom = v.min(axis=1) - 1, v.max(axis=1) + 3
    # What reaches behind the image plane has no bounds in it, but still a side it is on.
    cut = np.any(seen[..., 2] < 0.3, axis=1)
    side = np.sign(seen[..., 0])
    left[cut & ~np.all(side > 0, axis=1)] = 0
    right[cut & ~np.all(side < 0, axis=1)] = camera.width_px
    top[cut], bottom[cut] = 0, camera.height_px
    near = ~np.all(seen[..., 2] < 0.1, axis=1)
    near &= (left < camera.width_px) & (right > 0) & (top < camera.height_px) & (bottom > 0)
    for i in np.flatnonzero(near):
        rows = slice(max(int(top[i]), 0), int(bottom[i]))
        mask[rows, max(int(left[i]), 0) : int(right[i])] = True
    return moment.select(near), np.flatnonzero(mask).astype(np.int32)
