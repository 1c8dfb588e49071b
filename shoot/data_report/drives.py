"""Scenes, poses and motion of a data set."""

from collections.abc import Iterator
from datetime import datetime, timezone
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lss_core.data.samples import SampleIndex
from lss_core.data.splits import has_own_splits, scenes_of_split, split_names
from lss_core.geometry import FloatArray, direction_of, wrap_angle
from shoot.data_report.facts import DriveFacts, FutureFacts, MotionFacts, SplitFacts, Spread
from shoot.footprint import turn
from shoot.metrics.manoeuvres import MANOEUVRES, classify_manoeuvres
from shoot.trajectories import mine_futures

_STEP_S = 0.5
_STANDING_MPS = 0.2
_DRIVING_MPS = 2.0
_TURNING_RADPS = 0.05
# A step between poses is a gap if it is so many times as long as the usual one.
_GAP = 3.0
_NAMED = 3


def describe_drives(index: SampleIndex, folder: Path) -> DriveFacts:
    """Scenes, splits, and how dense keyframes and poses are.

    Args:
        index: Of the data set.
        folder: Holds its tables.

    Raises:
        DataError: If `splits.json` is not what it should be.
    """
    splits, num_in_no_split = _splits(index, folder)
    order = np.lexsort((index.time_s, index.sample_scene))
    keyframe_step_s = _steps(index.time_s[order], index.sample_scene[order])
    scene_of_pose = np.repeat(np.arange(len(index.scene_name)), np.diff(index.track_start))
    pose_step_s = _steps(index.track_time_s, scene_of_pose)
    usual_s = float(np.median(pose_step_s)) if len(pose_step_s) else 0.0
    times_s = index.track_time_s
    return DriveFacts(
        num_scenes=len(index.scene_name),
        num_logs=len(set(index.scene_log.tolist())),
        num_samples=len(index.sample_token),
        num_poses=len(times_s),
        num_scenes_in_no_split=num_in_no_split,
        splits=splits,
        first=_date(times_s.min()) if len(times_s) else "",
        last=_date(times_s.max()) if len(times_s) else "",
        keyframe_step_s=Spread.of(keyframe_step_s),
        pose_step_s=Spread.of(pose_step_s),
        num_gaps=int((pose_step_s > _GAP * usual_s).sum()),
    )


def _splits(index: SampleIndex, folder: Path) -> tuple[tuple[SplitFacts, ...], int]:
    """Splits that matter here, and the number of scenes in none of them."""
    facts, named = [], np.zeros(len(index.scene_name), dtype=bool)
    is_own, present = has_own_splits(folder), set(index.scene_name.tolist())
    for name in split_names(folder):
        listed = dict.fromkeys(scenes_of_split(folder, name))
        here = np.isin(index.scene_name, list(listed))
        if not is_own and not here.any():
            continue
        missing = [scene for scene in listed if scene not in present]
        facts.append(
            SplitFacts(
                name=name,
                is_own=is_own,
                num_listed=len(listed),
                num_scenes=len(listed) - len(missing),
                num_samples=int(here[index.sample_scene].sum()),
                missing=tuple(missing[:_NAMED]),
            )
        )
        named |= here
    return tuple(facts), int((~named).sum())


def _steps(time_s: FloatArray, scene: NDArray[np.int64]) -> FloatArray:
    """Times between those that follow each other in a scene."""
    steps: FloatArray = np.diff(time_s)[np.diff(scene) == 0]
    return steps


def _date(time_s: np.float64) -> str:
    try:
        return f"{datetime.fromtimestamp(float(time_s), timezone.utc):%Y-%m-%d}"
    except (ValueError, OverflowError, OSError):  # as of the year 12,000
        return "no date"


def describe_motion(index: SampleIndex) -> MotionFacts:
    """Speeds, and how the ego frame lies to its motion and to gravity.

    Scenes with problems are looked at, too: what is wrong with them shows here.
    """
    parts = list(_half_seconds(index))
    motion = np.concatenate(parts) if parts else np.zeros((0, 3))
    velocity_mps, yaw_rate_radps = motion[:, :2], motion[:, 2]
    speed_mps = np.linalg.norm(velocity_mps, axis=-1)
    driving = speed_mps > _DRIVING_MPS
    upright = np.clip(index.global_from_track[:, 2, 2], -1.0, 1.0)
    return MotionFacts(
        hours=len(motion) * _STEP_S / 3600.0,
        speed_mps=Spread.of(speed_mps),
        standing=_share(speed_mps < _STANDING_MPS),
        reversing=_share(velocity_mps[:, 0] < -_STANDING_MPS),
        turning=_share(np.abs(yaw_rate_radps) > _TURNING_RADPS),
        off_axis_deg=Spread.of(np.degrees(_around_middle(direction_of(velocity_mps[driving])))),
        num_off_axis=int(driving.sum()),
        tilt_deg=Spread.of(np.degrees(np.arccos(upright))),
    )


def _half_seconds(index: SampleIndex) -> Iterator[FloatArray]:
    """[H, 3] of each scene: velocity in the ego frame amid the half second, and yaw rate."""
    for scene in range(len(index.scene_name)):
        track = index.track(scene)
        time_s = index.track_time_s[track]
        if len(time_s) < 2 or time_s[-1] - time_s[0] < _STEP_S:
            continue
        time_s = time_s - time_s[0]
        at_s = np.arange(0.0, time_s[-1] + 1e-6, _STEP_S)
        x_m, y_m = (np.interp(at_s, time_s, column) for column in index.track_xy_m[track].T)
        heading = np.unwrap(index.track_yaw_rad[track])
        ends = np.interp(at_s, time_s, heading)
        middle = np.interp(at_s[:-1] + 0.5 * _STEP_S, time_s, heading)
        velocity = np.diff(np.stack([x_m, y_m], axis=-1), axis=0) / _STEP_S
        yield np.concatenate([turn(velocity, -middle), np.diff(ends)[:, None] / _STEP_S], axis=-1)


def _around_middle(angles_rad: FloatArray) -> FloatArray:
    """Angles unwrapped around their mean direction, so that they have a median."""
    if not len(angles_rad):
        return angles_rad
    middle = np.angle(np.exp(1j * angles_rad).sum())
    unwrapped: FloatArray = middle + wrap_angle(angles_rad - middle)
    return unwrapped


def _share(mask: NDArray[np.bool_]) -> float:
    return float(mask.mean()) if len(mask) else float("nan")


def describe_futures(index: SampleIndex) -> FutureFacts:
    """How much can be learnt from."""
    rows = np.flatnonzero(index.scene_problem[index.sample_scene] == 0)
    if not len(rows):
        return FutureFacts(0, 0, dict.fromkeys(MANOEUVRES, 0))
    rows = rows[np.lexsort((index.time_s[rows], index.sample_scene[rows]))]
    labels = mine_futures(index, rows, "keyframes")
    names = classify_manoeuvres(labels.xy_m).tolist()
    return FutureFacts(
        num_labels=len(labels.xy_m),
        num_starts=len(mine_futures(index, rows, "sweeps").xy_m),
        manoeuvres={name: names.count(name) for name in MANOEUVRES},
    )
