"""Poses of images held against the track of their scene: both are the same car's."""

import numpy as np
from numpy.typing import NDArray

from lss_core.data.tables.tracks import Tracks
from lss_core.geometry import FloatArray, wrap_angle, yaw_of

# One pose may serve several sensors, and clocks of sensors differ.
_SHARED_S = 0.12
_PLACE_SLACK_M = 0.75
_YAW_SLACK_RAD = 0.25
# Before and after it, a track says nothing of an image.
_NEAR_S = 0.1


def astray(
    tracks: Tracks, scene: NDArray[np.int64], time_s: FloatArray, global_from_egocam: FloatArray
) -> dict[int, str]:
    """What is wrong with those images at whose time the track is elsewhere, by row.

    Args:
        tracks: Of all scenes.
        scene: [I] of each image.
        time_s: [I].
        global_from_egocam: [I, 4, 4] the car, as the image has it.
    """
    start = np.searchsorted(tracks.scene, scene)
    end = np.searchsorted(tracks.scene, scene, side="right") - 1
    rows = np.flatnonzero(end > start)
    if not len(rows):
        return {}
    start, end, time_s = start[rows], end[rows], time_s[rows]
    first = _before(tracks, scene[rows], time_s).clip(start, end - 1)
    step_s = tracks.time_s[first + 1] - tracks.time_s[first]
    share = ((time_s - tracks.time_s[first]) / step_s).clip(0.0, 1.0)
    way_m = tracks.place_m[first + 1, :2] - tracks.place_m[first, :2]
    place_m = tracks.place_m[first, :2] + share[:, None] * way_m
    away_m = np.hypot(*(global_from_egocam[rows, :2, 3] - place_m).T)
    turn_rad = wrap_angle(tracks.yaw_rad[first + 1] - tracks.yaw_rad[first])
    yaw_rad = tracks.yaw_rad[first] + share * turn_rad
    turned_rad = np.abs(wrap_angle(yaw_of(global_from_egocam[rows]) - yaw_rad))
    speed_mps = np.hypot(*way_m.T) / step_s
    within = (time_s > tracks.time_s[start] - _NEAR_S) & (time_s < tracks.time_s[end] + _NEAR_S)
    is_away = within & (away_m > _PLACE_SLACK_M + _SHARED_S * speed_mps)
    is_turned = within & (turned_rad > _YAW_SLACK_RAD + _SHARED_S * np.abs(turn_rad) / step_s)
    texts = {}
    for place in np.flatnonzero(is_away | is_turned).tolist():
        text = (
            f"a car {away_m[place]:.2g} m from where its scene's other poses have it at that time, "
            f"turned by {np.rad2deg(turned_rad[place]):.0f} degrees"
        )
        if is_away[place] and not is_turned[place] and speed_mps[place] > 1.0:
            text += f"; its time looks wrong by {away_m[place] / speed_mps[place]:.2g} s"
        texts[int(rows[place])] = text
    return texts


def _before(tracks: Tracks, scene: NDArray[np.int64], time_s: FloatArray) -> NDArray[np.int64]:
    """[I] row of the last pose before each time, within its scene if there is one."""
    begins_s = np.zeros(int(tracks.scene.max()) + 1)
    begins_s[tracks.scene[tracks.starts]] = tracks.time_s[tracks.starts]
    since_s, image_s = tracks.time_s - begins_s[tracks.scene], time_s - begins_s[scene]
    # One axis of time on which the scenes lie apart.
    longest_s = since_s.max() + 2.0 * _NEAR_S
    axis_s = since_s + longest_s * tracks.scene
    wanted_s = image_s.clip(-_NEAR_S, longest_s - _NEAR_S) + longest_s * scene
    before: NDArray[np.int64] = np.searchsorted(axis_s, wanted_s, side="right") - 1
    return before
