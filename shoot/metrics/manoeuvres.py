"""Sorts driven paths into standing, straight, left and right."""

import math
from typing import Any

import numpy as np
from jaxtyping import Float, Shaped

from lss_core.geometry import direction_of

Array = np.ndarray[Any, np.dtype[Any]]

MANOEUVRES = ("standing", "straight", "left", "right")


def heading_changes(
    futures: Float[Array, "S T 2"], step_m: float = 1.0
) -> tuple[Float[Array, " S"], Shaped[Array, " S"]]:
    """Total change of heading along each path, and whether it ever moves.

    The direction between two points close together is mostly noise, so headings are taken between
    points at least `step_m` apart, however long the ego needs for that. Their changes add up, so a
    turn of more than half a circle keeps its sign. A step of more than a quarter circle is driving
    backwards, since no car turns so sharply within a metre.

    Args:
        futures: Points in metres in `ego` at the start, where the path begins at the origin with
            heading 0 (along x).
        step_m: Length over which a heading is taken.

    Returns:
        Change of heading in rad, positive to the left (0 where it never moves); and True where the
        path leaves the circle of radius `step_m` around its start.

    Raises:
        ValueError: If `step_m` is not more than 0, or the paths are no finite [S, T, 2].
    """
    if not step_m > 0.0:
        raise ValueError(f"The step must be more than 0 m, got {step_m}.")
    if futures.ndim != 3 or futures.shape[2] != 2 or not np.isfinite(futures).all():
        raise ValueError(f"Futures must be finite and [S, T, 2], got {list(futures.shape)}.")
    num_samples = len(futures)
    anchor = np.zeros((num_samples, 2))
    heading_rad = np.zeros(num_samples)
    is_moving = np.zeros(num_samples, dtype=bool)
    for point in np.moveaxis(futures.astype(np.float64), 1, 0):
        chord = point - anchor
        far = np.hypot(chord[:, 0], chord[:, 1]) >= step_m
        change_rad = direction_of(chord) - heading_rad
        # Modulo half a circle: forwards and backwards along a line are the same heading.
        change_rad = (change_rad + math.pi / 2) % math.pi - math.pi / 2
        heading_rad = np.where(far, heading_rad + change_rad, heading_rad)
        anchor = np.where(far[:, None], point, anchor)
        is_moving |= far
    return heading_rad, is_moving


def classify_manoeuvres(
    futures: Float[Array, "S T 2"], standing_m: float = 1.0, turn_rad: float = math.radians(20.0)
) -> Shaped[Array, " S"]:
    """Name of the manoeuvre of each path, one of `MANOEUVRES`.

    Standing: no point is `standing_m` or more from the start. Left or right: the heading changes by
    more than `turn_rad` over the horizon (at an intersection, but also in a long bend). Straight:
    the rest, lane changes and driving backwards included.

    Args:
        futures: Points in metres in `ego` at the start.
        standing_m: Least distance that counts as moving.
        turn_rad: Least change of heading that counts as turning.
    """
    change_rad, is_moving = heading_changes(futures, step_m=standing_m)
    names: Array = np.select(
        [~is_moving, change_rad > turn_rad, change_rad < -turn_rad],
        ["standing", "left", "right"],
        default="straight",
    )
    return names
