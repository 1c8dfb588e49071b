"""Whether the ego ran a red light: TLC."""

from typing import Any

import numpy as np
import shapely
from jaxtyping import Bool

from shoot.metrics.driving_score.surroundings import Surroundings, Whereabouts
from shoot.metrics.driving_score.tracks import Track

Array = np.ndarray[Any, np.dtype[Any]]


def red_touches(
    ego: Track, around: Surroundings, where: Whereabouts, strict: bool = False
) -> Bool[Array, "N T"]:
    """Whether the footprint touches, at each step, what lies behind each red light.

    Who is inside already when the light turns red may clear the intersection: as long as it stays
    red nothing counts. Inside is who has the middle of the footprint on the connector or in an
    intersection; a bumper over the line is not enough. The first step counts as turning red.

    Args:
        ego: Its track.
        around: Its lights cover the track's steps.
        where: Of the ego.
        strict: Nobody may clear the intersection: every touch counts.

    Raises:
        ValueError: If lights have other steps than the track.
    """
    lights = around.lights
    if not lights.connectors:
        return np.zeros((0, len(ego)), dtype=bool)
    is_red = lights.is_red
    if is_red.shape[1] != len(ego):
        raise ValueError(
            f"Lights must have the {len(ego)} steps of the ego's track, got {is_red.shape[1]}."
        )
    connectors = np.array(lights.connectors, dtype=object)[:, None]
    touches = is_red & shapely.intersects(connectors, shapely.polygons(ego.corners_m))
    if strict:
        return touches
    is_inside = where.is_centre_in_intersection | shapely.intersects(
        connectors, shapely.points(ego.centre_m)
    )
    turns_red = is_red.copy()
    turns_red[:, 1:] &= ~is_red[:, :-1]
    # While a light is red, `began` is the step at which it turned.
    began = np.maximum.accumulate(np.where(turns_red, np.arange(len(ego)), 0), axis=1)
    return np.asarray(touches & ~np.take_along_axis(is_inside, began, axis=1))


def traffic_light(red: Bool[Array, "N T"]) -> float:
    """TLC: 0 if any touch counts, see `red_touches`, else 1."""
    return float(not red.any())


def count_red_lights(around: Surroundings, red: Bool[Array, "N T"]) -> int:
    """How often a light was run: each once as long as it stays red.

    Args:
        around: Its lights.
        red: See `red_touches`.
    """
    is_red = around.lights.is_red
    runs = 0
    for touched, lit in zip(red, is_red, strict=True):
        phase = np.cumsum(np.diff(lit.astype(int), prepend=0) == 1)
        runs += len(np.unique(phase[touched]))
    return runs
