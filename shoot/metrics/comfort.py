"""How a path would feel: acceleration, jerk, and whether both stay within bounds."""

from typing import Any

import numpy as np
from jaxtyping import Float

from shoot.trajectories import DT_S

Array = np.ndarray[Any, np.dtype[Any]]

# NAVSIM's bounds (from nuPlan), themselves out of bounds.
LON_ACCEL_MIN_MPS2, LON_ACCEL_MAX_MPS2 = -4.05, 2.40
LAT_ACCEL_MAX_MPS2 = 4.89
JERK_MAX_MPS3 = 8.37

# Slower than this the direction of motion is no more than rounding.
_STANDING_MPS = 1e-6


def measure_comfort(
    paths: Float[Array, "P T 2"], dt_s: float = DT_S
) -> dict[str, Float[Array, " P"]]:
    """Largest accelerations and jerk along each path, by finite differences of its points.

    Velocity is the difference of two points, acceleration of two velocities, jerk of two
    accelerations. Ahead and aside are told apart by the direction of motion over the two steps
    around a point, so a circle at constant speed has no acceleration ahead, standing still has none
    at all, and driving backwards counts as driving. A path that turns on its heel brakes.

    `comfort` uses four of NAVSIM's bounds: longitudinal acceleration (braking and speeding up
    apart), lateral acceleration, and jerk. It is not NAVSIM's figure: that smooths over the whole
    path, takes jerk as the change of the amount of acceleration, and bounds longitudinal jerk, yaw
    rate and yaw acceleration too. Yaw is left out here, for a path of points has a heading only
    while it moves, and at walking speed its changes are mostly noise.

    How to read the numbers at steps of 0.25 s:

    - What is shorter than a step is averaged away; what is noise of the points is magnified, by up
      to 8 / dt_s^3 in jerk: one centimetre makes up to 5 m/s^3. Driven paths with noisy poses can
      therefore look rougher than they were.
    - Templates are K-Means means. The differences of a mean are the mean of the differences, so a
      template of many futures is smoother than those; one of few keeps their noise. Compared with
      drivers templates look too good: in the synthetic city 97 % of them are comfortable, of the
      driven paths 67 % (whose drivers speed up at about the bound).
    - The path's first speed is taken as it is. A path that stands still is comfortable by these
      figures also for an ego that is driving 10 m/s.

    Args:
        paths: Points in metres, the first at `dt_s`; each path starts at the origin at time 0.
        dt_s: Time between points.

    Returns:
        `lon_accel_mps2`, `lat_accel_mps2`, `jerk_mps3`: largest absolute values along the path;
        `comfort`: 100 where all of it is within the bounds, else 0. All NaN with fewer than three
        points, which have no jerk.

    Raises:
        ValueError: If `dt_s` is not more than 0, or the paths are no [P, T, 2].
    """
    if not dt_s > 0.0:
        raise ValueError(f"dt_s must be more than 0 s, got {dt_s}.")
    if paths.ndim != 3 or paths.shape[2] != 2:
        raise ValueError(f"Paths must be [P, T, 2], got {list(paths.shape)}.")
    names = ("lon_accel_mps2", "lat_accel_mps2", "jerk_mps3", "comfort")
    num_paths, num_points, _ = paths.shape
    if num_points < 3:
        return {name: np.full(num_paths, np.nan) for name in names}
    points = np.concatenate([np.zeros((num_paths, 1, 2)), paths.astype(np.float64)], axis=1)
    velocity = np.diff(points, axis=1) / dt_s
    accel = np.diff(velocity, axis=1) / dt_s
    jerk = np.linalg.norm(np.diff(accel, axis=1) / dt_s, axis=-1).max(axis=1)

    before, after = velocity[:, :-1], velocity[:, 1:]
    mean = 0.5 * (before + after)
    is_moving = np.linalg.norm(mean, axis=-1, keepdims=True) > _STANDING_MPS
    ahead = np.where(is_moving, mean, before)
    ahead = ahead / np.maximum(np.linalg.norm(ahead, axis=-1, keepdims=True), _STANDING_MPS)
    lon = (ahead * accel).sum(axis=-1)
    lat = np.abs(ahead[..., 0] * accel[..., 1] - ahead[..., 1] * accel[..., 0]).max(axis=1)

    is_comfortable = (
        (lon.min(axis=1) > LON_ACCEL_MIN_MPS2)
        & (lon.max(axis=1) < LON_ACCEL_MAX_MPS2)
        & (lat < LAT_ACCEL_MAX_MPS2)
        & (jerk < JERK_MAX_MPS3)
    )
    return dict(
        zip(names, (np.abs(lon).max(axis=1), lat, jerk, 100.0 * is_comfortable), strict=True)
    )
