"""The ground the ego covers: a rectangle that turns with the path, and when rectangles overlap."""

from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from lss_core.geometry import direction_of, wrap_angle

Array = np.ndarray[Any, np.dtype[Any]]

EGO_LENGTH_M = 4.1
EGO_WIDTH_M = 1.85
EGO_REAR_M = 1.0  # rear bumper to rear axle, which is the origin of `ego`

# Below this speed (0.1 m in 0.25 s) the car stands: the direction from one point of a path to the
# next is that of the noise in their positions.
STANDS_MPS = 0.4


def turn(vectors: Float[Array, "*#S 2"], angle_rad: Float[Array, "*#S"]) -> Float[Array, "*S 2"]:
    """The vectors, turned to the left by an angle each."""
    cos, sin = np.cos(angle_rad), np.sin(angle_rad)
    x, y = vectors[..., 0], vectors[..., 1]
    turned: Array = np.stack([cos * x - sin * y, sin * x + cos * y], axis=-1)
    return turned


def headings(paths_m: Float[Array, "*S T 2"], dt_s: float = 0.25) -> Float[Array, "*S T"]:
    """Where the car points at each point of its path, in radians to the left of the start.

    It is the direction from the point before to the point after (at the end: from the one before),
    which on a circle is the tangent, since the path is that of the rear axle. A car that stands
    keeps its heading; at the start, which is none of the points, it is 0. A car does not turn by
    more than 90 degrees from one point to the next: where the direction does, it drives backward.

    Args:
        paths_m: Points in metres in `ego`, evenly spaced in time; the start is the origin.
        dt_s: Time between points; the first is at `dt_s`.
    """
    points_m = np.concatenate([np.zeros_like(paths_m[..., :1, :]), paths_m], axis=-2)
    after_m = np.concatenate([points_m[..., 2:, :], points_m[..., -1:, :]], axis=-2)
    chord_m = after_m - points_m[..., :-1, :]
    num_steps = np.full(paths_m.shape[-2], 2)
    num_steps[-1:] = 1
    moves = np.hypot(chord_m[..., 0], chord_m[..., 1]) >= STANDS_MPS * dt_s * num_steps
    direction_rad = direction_of(chord_m)
    heading_rad = np.zeros(paths_m.shape[:-1])
    before_rad = np.zeros(paths_m.shape[:-2])
    for step in range(paths_m.shape[-2]):
        ahead_rad = direction_rad[..., step]
        ahead_rad = ahead_rad + np.pi * (np.cos(ahead_rad - before_rad) < 0.0)
        before_rad = np.where(moves[..., step], ahead_rad, before_rad)
        heading_rad[..., step] = before_rad
    return wrap_angle(heading_rad)


def footprint_centres(
    paths_m: Float[Array, "*S 2"], heading_rad: Float[Array, "*S"]
) -> Float[Array, "*S 2"]:
    """Middles of the footprints, in the frame of the path; its points are the rear axle's."""
    return paths_m + turn(np.array([EGO_LENGTH_M / 2 - EGO_REAR_M, 0.0]), heading_rad)


def footprint_corners(
    paths_m: Float[Array, "*S 2"], heading_rad: Float[Array, "*S"]
) -> Float[Array, "*S 4 2"]:
    """Corners of the footprints, in the frame of the path.

    Args:
        paths_m: The rear axle, which is the origin of `ego`.
        heading_rad: Where the car points, see `headings`.

    Returns:
        Front left, rear left, rear right, front right.
    """
    front_m, left_m = EGO_LENGTH_M - EGO_REAR_M, EGO_WIDTH_M / 2
    corners_m = np.array(
        [[front_m, left_m], [-EGO_REAR_M, left_m], [-EGO_REAR_M, -left_m], [front_m, -left_m]]
    )
    return paths_m[..., None, :] + turn(corners_m, heading_rad[..., None])


def rectangles_overlap(
    centre_m: Float[Array, "*#S 2"],
    yaw_rad: Float[Array, "*#S"],
    size_m: Float[Array, "*#S 2"],
    other_centre_m: Float[Array, "*#S 2"],
    other_yaw_rad: Float[Array, "*#S"],
    other_size_m: Float[Array, "*#S 2"],
) -> Bool[Array, "*S"]:
    """Whether rectangles share ground; those that only touch do not.

    Two convex shapes are apart if and only if some line parallel to a side of one of them parts
    them. So their shadows on the four directions of the sides are compared.

    Args:
        centre_m: Of the first rectangles.
        yaw_rad: Direction of their length.
        size_m: Their length and width.
        other_centre_m: Of the second rectangles, in the same frame.
        other_yaw_rad: Direction of their length.
        other_size_m: Their length and width.
    """
    between_m = other_centre_m - centre_m
    cos, sin = np.abs(np.cos(other_yaw_rad - yaw_rad)), np.abs(np.sin(other_yaw_rad - yaw_rad))
    half_m, other_half_m = size_m / 2, other_size_m / 2

    def meet(half_m: Array, other_half_m: Array, yaw_rad: Array) -> Array:
        """On the two directions of one rectangle's sides."""
        apart_m = np.abs(turn(between_m, -yaw_rad))
        ahead_m = half_m[..., 0] + other_half_m[..., 0] * cos + other_half_m[..., 1] * sin
        aside_m = half_m[..., 1] + other_half_m[..., 0] * sin + other_half_m[..., 1] * cos
        both: Array = (apart_m[..., 0] < ahead_m) & (apart_m[..., 1] < aside_m)
        return both

    overlap: Array = meet(half_m, other_half_m, yaw_rad) & meet(other_half_m, half_m, other_yaw_rad)
    return overlap
