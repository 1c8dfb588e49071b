"""Poses held against gravity, their motion and each other: what no car's poses are."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lss_core.data.checks.heading import heading_flaws
from lss_core.data.tables.tracks import Tracks
from lss_core.geometry import FloatArray

# The steepest streets rise by 19 degrees.
_STEEPEST_RAD = np.deg2rad(30.0)
# Distances from the earth's centre, and heights that no street has.
_EARTH_RADIUS_M = (6.33e6, 6.40e6)
_HIGHEST_M = 10_000.0
# What a car does: no street car is this fast for long, turns tighter, brakes or steers harder.
_TOP_SPEED_MPS = 90.0
_RADIUS_M = 2.5
_GRIP_MPS2 = 12.0
_HARDEST_MPS2 = 15.0
# What localisation and clocks add to that.
_YAW_SLACK_RAD = 0.2
_PLACE_SLACK_M = 0.5
_CLOCK_SLACK_S = 0.08  # as where each sensor has the nearest of ten poses a second
# A single clock is hardly wrong by more.
_LATEST_S = 5.0
# Poses may stand still for so long, or be behind by so much, because several sensors share one.
_SHARED_S = 0.15
_SHARED_M = 0.5
# A car that stands at one pose is this near at the next, as far as it does not accelerate.
_START_SLACK_M = 0.3
_STANDING_M = 0.1


@dataclass(frozen=True)
class Flaw:
    """What no car's poses do.

    Attributes:
        reason: Its kind.
        row: Of the pose where it shows.
        measured: What was seen.
        mistake: What is likely the cause; empty if it is not known.
        by_frame: Whether it may come from another frame or order of numbers of all poses.
    """

    reason: str
    row: int
    measured: str
    mistake: str = ""
    by_frame: bool = False


def find_flaws(tracks: Tracks) -> dict[int, Flaw]:
    """The first flaw that each scene's poses have, by scene."""
    found: dict[int, Flaw] = {}
    if len(tracks.time_s):
        for check in (_tilted, _too_fast, _repeated, _off_heading, _turned, _displaced):
            for scene, flaw in check(tracks):
                found.setdefault(scene, flaw)
    return found


def _tilted(tracks: Tracks) -> Iterator[tuple[int, Flaw]]:
    """Ego frames whose z axis is not up."""
    tilt_rad = np.arccos(np.clip(tracks.global_from_ego[:, 2, 2], -1.0, 1.0))
    from_centre_m = np.linalg.norm(tracks.place_m, axis=-1)
    nearest_m, farthest_m = _EARTH_RADIUS_M
    like_earth = (from_centre_m > nearest_m) & (from_centre_m < farthest_m)
    is_tilted = tilt_rad > _STEEPEST_RAD
    bad = is_tilted | (like_earth & (np.abs(tracks.place_m[:, 2]) > _HIGHEST_M))
    for scene, row in _worst(tracks.scene, bad, tilt_rad):
        measured = (
            f"the ego's z axis is {np.rad2deg(tilt_rad[row]):.0f} degrees off the global one"
            if is_tilted[row]
            else f"the ego is {tracks.place_m[row, 2] / 1e3:.0f} km high"
        )
        if like_earth[row]:
            mistake = (
                f"{from_centre_m[row] / 1e3:.0f} km from the origin, the translation looks like "
                "earth-centred coordinates (ECEF); make them a local east-north-up frame"
            )
            yield scene, Flaw("pose against gravity", row, measured, mistake)
        else:
            yield scene, Flaw("pose against gravity", row, measured, by_frame=True)


def _too_fast(tracks: Tracks) -> Iterator[tuple[int, Flaw]]:
    """Scenes that are too fast as a whole, because lengths or times are in other units."""
    ends = tracks.ends
    counts = ends - tracks.starts + 1
    lasts_s = tracks.time_s[ends] - tracks.time_s[tracks.starts]
    moved_m = np.hypot(*(tracks.place_m[ends] - tracks.place_m[tracks.starts])[:, :2].T)
    for place in np.flatnonzero((counts >= 10) & (lasts_s < 1e-3 * counts)).tolist():
        row = int(tracks.starts[place])
        measured = f"{counts[place]} poses within {lasts_s[place]:.2g} s"
        unit = "milliseconds" if lasts_s[place] > 1e-6 * counts[place] else "seconds"
        mistake = f"the time stamps look like {unit} instead of microseconds"
        yield int(tracks.scene[row]), Flaw("impossible motion", row, measured, mistake)
    is_fast = (counts >= 3) & (moved_m > _TOP_SPEED_MPS * np.maximum(lasts_s, 0.5))
    for place in np.flatnonzero(is_fast).tolist():
        row = int(tracks.starts[place])
        speed_mps = moved_m[place] / lasts_s[place]
        steps_m = np.hypot(*np.diff(tracks.place_m[row : ends[place] + 1, :2], axis=0).T)
        # One jump is another mistake than speed all the way.
        if steps_m.max() > 0.5 * steps_m.sum():
            continue
        measured = f"it moves at {speed_mps:.3g} m/s all the way"
        units = [
            name
            for name, factor in (("centimetres", 1e-2), ("millimetres", 1e-3))
            if 2.0 < factor * speed_mps < 0.5 * _TOP_SPEED_MPS
        ]
        mistake = f"the translation looks like {' or '.join(units)}" if units else ""
        yield (
            int(tracks.scene[row]),
            Flaw("impossible motion", row, measured, mistake, by_frame=True),
        )


def _repeated(tracks: Tracks) -> Iterator[tuple[int, Flaw]]:
    """Places that stay exactly the same for a while, from which the car then jumps."""
    steps = tracks.steps
    is_same = (steps.elapsed_s > 0.0) & (np.diff(tracks.place_m, axis=0) == 0.0).all(axis=-1)
    edges = np.diff(np.concatenate([[0], is_same.astype(np.int64), [0]]))
    first, last = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    if not len(first):
        return
    # A step over the edge of a scene takes no time and leads nowhere.
    elapsed_s = np.concatenate([[0.0], steps.elapsed_s, [0.0]])
    moved_m = np.concatenate([[0.0], steps.moved_m, [0.0]])
    in_s, out_s, in_m, out_m = (
        elapsed_s[first],
        elapsed_s[last + 1],
        moved_m[first],
        moved_m[last + 1],
    )
    lasts_s = tracks.time_s[last] - tracks.time_s[first]
    behind_m = lasts_s * (in_m + out_m) / (in_s + lasts_s + out_s)
    jumps = np.maximum(in_m - 5.0 * in_s**2, out_m - 5.0 * out_s**2) > _START_SLACK_M
    bad = jumps & (lasts_s > _SHARED_S) & (behind_m > _SHARED_M)
    counts = np.bincount(tracks.scene[first[bad]], weights=(last - first)[bad])
    for scene, run in _worst(tracks.scene[first], bad, behind_m):
        measured = (
            f"{counts[scene]:.0f} poses repeat the one before, here for {lasts_s[run]:.2g} s, "
            f"while the car drives on by {behind_m[run]:.2g} m"
        )
        mistake = "it looks as if the pose of a keyframe were copied to the sweeps around it"
        yield scene, Flaw("repeated pose", int(first[run]) + 1, measured, mistake)


def _off_heading(tracks: Tracks) -> Iterator[tuple[int, Flaw]]:
    """Scenes that drive in another direction than that of the ego's x axis."""
    for scene, measured in heading_flaws(tracks.motion).items():
        row = int(np.searchsorted(tracks.scene, scene))
        yield scene, Flaw("heading against motion", row, measured, by_frame=True)


def _turned(tracks: Tracks) -> Iterator[tuple[int, Flaw]]:
    """Headings that change more from one pose to the next than wheels can steer."""
    steps = tracks.steps
    moved_m = steps.moved_m
    steered_rad = 2.0 * np.arcsin(np.minimum(1.0, moved_m / (2.0 * _RADIUS_M)))
    gripped_rad = _GRIP_MPS2 * steps.elapsed_s**2 / np.maximum(moved_m, 1e-9)
    turned_rad = np.abs(steps.turned_rad)
    bad = turned_rad > _YAW_SLACK_RAD + np.minimum(steered_rad, gripped_rad)
    if not bad.any():
        return
    around_m = np.concatenate([[np.inf], moved_m, [np.inf]])
    slowest_m = np.minimum(np.minimum(around_m[:-2], around_m[2:]), moved_m)
    counts = np.bincount(tracks.scene[:-1][bad])
    for scene, row in _worst(tracks.scene[:-1], bad, turned_rad):
        measured = (
            f"from there to the next pose the heading turns by {np.rad2deg(turned_rad[row]):.0f} "
            f"degrees within {moved_m[row]:.2g} m"
            + (f", as at {counts[scene] - 1} other places" if counts[scene] > 2 else "")
        )
        own = bad & (tracks.scene[:-1] == scene)
        if (slowest_m[own] < _STANDING_M).mean() > 0.5:
            mistake = (
                "the heading looks made from successive places, which say nothing of a car that "
                "stands"
            )
        elif counts[scene] <= 2:
            mistake = "this one heading looks wrong"
        else:
            mistake = ""
        yield scene, Flaw("heading that jumps", row, measured, mistake, by_frame=not mistake)


def _displaced(tracks: Tracks) -> Iterator[tuple[int, Flaw]]:
    """Places off the way from the one before to the one after, by more than a car can do."""
    steps = tracks.steps
    in_s, out_s = steps.elapsed_s[:-1], steps.elapsed_s[1:]
    within = (in_s > 0.0) & (out_s > 0.0)
    span_s = np.where(within, in_s + out_s, 1.0)
    place_m = tracks.place_m[:, :2]
    way_m = place_m[2:] - place_m[:-2]
    off_m = place_m[1:-1] - place_m[:-2] - way_m * (in_s / span_s)[:, None]
    distance_m = np.hypot(*off_m.T)
    speed_mps = np.hypot(*way_m.T) / span_s
    allowed_m = _PLACE_SLACK_M + _CLOCK_SLACK_S * speed_mps + 0.5 * _HARDEST_MPS2 * in_s * out_s
    bad = within & (distance_m > allowed_m)
    for scene, row in _worst(tracks.scene[1:-1], bad, distance_m - allowed_m):
        measured = f"it is {distance_m[row]:.2g} m off the way between the poses around it"
        mistake = _why_displaced(off_m[row], way_m[row], float(speed_mps[row]))
        yield scene, Flaw("place off its path", row + 1, measured, mistake)


def _why_displaced(off_m: FloatArray, way_m: FloatArray, speed_mps: float) -> str:
    distance_m, along_m = float(np.hypot(*off_m)), float(off_m @ way_m)
    along_m /= max(float(np.hypot(*way_m)), 1e-9)
    along_s = along_m / max(speed_mps, 1.0)
    is_driving = 1.0 < speed_mps < _TOP_SPEED_MPS
    if not is_driving or abs(along_m) < 0.95 * distance_m or abs(along_s) > _LATEST_S:
        return ""
    when = "early" if along_m > 0.0 else "late"
    return f"its time stamp looks {abs(along_s):.2g} s too {when}, or its place wrong"


def _worst(
    scene: NDArray[np.int64], bad: NDArray[np.bool_], amount: FloatArray
) -> list[tuple[int, int]]:
    """Scenes with something bad, and the row where there is most of it."""
    rows = np.flatnonzero(bad)
    rows = rows[np.argsort(-amount[rows], kind="stable")]
    scenes, place = np.unique(scene[rows], return_index=True)
    return list(zip(scenes.tolist(), rows[place].tolist(), strict=True))
