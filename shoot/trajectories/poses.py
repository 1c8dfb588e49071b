"""Recorded poses: whether they can be, and where the ego was between them."""

import numpy as np

from lss_core.geometry import FloatArray


def check_poses(
    times_s: FloatArray, xy_m: FloatArray, yaw_rad: FloatArray, starts_s: FloatArray
) -> None:
    """Check poses and the moments that are asked about.

    Args:
        times_s: [P] strictly increasing.
        xy_m: [P, 2] ego origin in a fixed frame.
        yaw_rad: [P] heading in the same frame.
        starts_s: [S] moments.

    Raises:
        ValueError: If poses or starts are not finite or of other shapes, or times do not increase.
    """
    num = len(times_s)
    shapes = [np.shape(array) for array in (times_s, xy_m, yaw_rad)]
    if shapes != [(num,), (num, 2), (num,)] or np.ndim(starts_s) != 1:
        raise ValueError(
            f"Poses must be times [P], places [P, 2], headings [P] and starts [S], got "
            f"{', '.join(str(list(shape)) for shape in (*shapes, np.shape(starts_s)))}."
        )
    if not all(np.isfinite(array).all() for array in (times_s, xy_m, yaw_rad, starts_s)):
        raise ValueError("Poses and starts must be finite, but hold NaN or infinity.")
    if np.any(np.diff(times_s) <= 0.0):
        raise ValueError("Pose times must increase.")


def positions_at(times_s: FloatArray, xy_m: FloatArray, query_s: FloatArray) -> FloatArray:
    """[..., 2] ego origin at each time asked about, in metres, linear between the poses."""
    x_m, y_m = (np.interp(query_s, times_s, xy_m[:, axis]) for axis in range(2))
    return np.stack([x_m, y_m], axis=-1)
