"""The nuScenes tables joined: tokens become rows of arrays, and what no index needs is dropped."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lss_core.data.tables.by_token import ByToken, rows_of
from lss_core.data.tables.frames import LIDAR, OTHER, FrameReader, Frames
from lss_core.data.tables.problems import Problem, is_time, time_problem
from lss_core.data.tables.reading import (
    CalibratedSensor,
    Log,
    Sample,
    SampleData,
    Scene,
    Sensor,
    read_table,
    table_path,
)
from lss_core.data.tables.transforms import ego_poses, intrinsics, mountings
from lss_core.errors import DataError
from lss_core.geometry import FloatArray


@dataclass(frozen=True)
class JoinedTables:
    """What the tables say of C scenes, S samples, F frames and K calibrations.

    What cannot be used of them has a problem, and harmless numbers: it stands still at the origin.

    Attributes:
        scenes: C records.
        locations: Where each scene was.
        samples: S records.
        calibrations: K records.
        sample_scene: [S] row of its scene.
        frames: Keyframes of the cameras asked for and all LIDAR_TOP sweeps; all frames of scenes
            without any.
        global_from_ego: [F, 4, 4] the car at each frame.
        ego_from_sensor: [K, 4, 4] mounting of each calibration; zero if no keyframe has it.
        rawpixel_from_camera: [K, 3, 3] of each calibration; zero if no camera's keyframe has it.
        lidar: [S] frame of its LIDAR_TOP keyframe; -1 where there is none.
        images: [S, N] frame of its keyframe of each camera; -1 where there is none.
        rivals: Frames that claim to be keyframes at other times than those taken.
        in_track: [F] whether a track has the frame, or would have it if it had no problem.
        track: [P] frames whose poses are the tracks of the scenes, one scene after the other, each
            increasing in time; those with a problem are none of them.
        track_start: [C + 1] where each scene's begin in `track`.
        sample_problems: What is wrong with the time of a sample that needs it, by row.
        pose_problems: What is wrong with time or pose, by frame.
        mounting_problems: What is wrong with `ego_from_sensor`, by row.
        intrinsics_problems: What is wrong with `rawpixel_from_camera`, by row.
    """

    scenes: list[Scene]
    locations: list[str]
    samples: list[Sample]
    calibrations: list[CalibratedSensor]
    sample_scene: NDArray[np.int64]
    frames: Frames
    global_from_ego: FloatArray
    ego_from_sensor: FloatArray
    rawpixel_from_camera: FloatArray
    lidar: NDArray[np.int64]
    images: NDArray[np.int64]
    rivals: NDArray[np.int64]
    in_track: NDArray[np.bool_]
    track: NDArray[np.int64]
    track_start: NDArray[np.int64]
    sample_problems: dict[int, Problem]
    pose_problems: dict[int, Problem]
    mounting_problems: dict[int, Problem]
    intrinsics_problems: dict[int, Problem]


def join_tables(folder: Path, cameras: tuple[str, ...]) -> JoinedTables:
    """Read the tables of a version's folder and follow their tokens.

    Args:
        folder: Holds the tables.
        cameras: Channels whose keyframes are wanted.

    Raises:
        DataError: If a table cannot be read, a camera is unknown, there is no sample or sensor
            record, a token leads nowhere or a file's name out of the data root.
    """
    sensors = {sensor.token: sensor.channel for sensor in read_table(folder, Sensor)}
    unknown = [camera for camera in cameras if camera not in sensors.values()]
    if unknown:
        raise DataError(
            f"The data set '{folder}' has no sensor {', '.join(unknown)}; "
            f"it has {', '.join(sorted(set(sensors.values())))}."
        )
    scenes, samples = read_table(folder, Scene), read_table(folder, Sample)
    if not scenes or not samples:
        raise DataError(f"The tables of '{folder}' hold no scene with samples.")
    return _join(folder, cameras, sensors, scenes, samples)


def _join(
    folder: Path,
    cameras: tuple[str, ...],
    sensors: dict[str, str],
    scenes: list[Scene],
    samples: list[Sample],
) -> JoinedTables:
    location = ByToken(
        folder, Log, Scene, ((log.token, log.location) for log in read_table(folder, Log))
    )
    scene_row = rows_of(folder, scenes, Sample)
    sample_scene = np.asarray([scene_row[sample.scene_token] for sample in samples], dtype=np.int64)
    calibrations = read_table(folder, CalibratedSensor)
    reader = FrameReader(folder, sensors, samples, calibrations, cameras)
    frames = reader.read(np.zeros(len(samples), dtype=bool))
    has_lidar = np.zeros(len(scenes), dtype=bool)
    has_lidar[sample_scene[frames.sample[frames.channel == LIDAR]]] = True
    if not has_lidar[sample_scene].all():
        frames = reader.read(~has_lidar[sample_scene])
    if not len(frames.sample):
        raise DataError(f"The table '{table_path(folder, SampleData)}' has no record that is used.")
    keyframe, rivals = _keyframes(frames, samples, len(reader.columns))
    images = keyframe[:, [reader.columns[camera] for camera in cameras]]
    global_from_ego, pose_problems = ego_poses(folder, frames.pose_token)
    pose_problems |= frames.time_problems
    frame_scene = sample_scene[frames.sample]
    in_track = (frames.channel == LIDAR) | ~has_lidar[frame_scene]
    is_sound = in_track.copy()
    is_sound[list(pose_problems)] = False
    track, track_start = _tracks(frames.time_us / 1e6, frame_scene, is_sound, len(scenes))
    ego_from_sensor, bad_mountings = mountings(folder, calibrations, _used(frames, keyframe))
    rawpixel_from_camera, bad_intrinsics = intrinsics(folder, calibrations, _used(frames, images))
    return JoinedTables(
        scenes=scenes,
        locations=[location[scene.log_token] for scene in scenes],
        samples=samples,
        calibrations=calibrations,
        sample_scene=sample_scene,
        frames=frames,
        global_from_ego=global_from_ego,
        ego_from_sensor=ego_from_sensor,
        rawpixel_from_camera=rawpixel_from_camera,
        lidar=keyframe[:, LIDAR],
        images=images,
        rivals=rivals,
        in_track=in_track,
        track=track,
        track_start=track_start,
        sample_problems=_sample_problems(folder, samples, keyframe[:, LIDAR]),
        pose_problems=pose_problems,
        mounting_problems=bad_mountings,
        intrinsics_problems=bad_intrinsics,
    )


def _sample_problems(
    folder: Path, samples: list[Sample], lidar: NDArray[np.int64]
) -> dict[int, Problem]:
    """Of samples without a lidar keyframe: only theirs is the time of the sample."""
    rows = np.flatnonzero(lidar < 0)
    times_us = np.asarray([samples[row].timestamp for row in rows.tolist()], dtype=np.float64)
    return {
        int(row): time_problem(folder, samples[row], samples[row].timestamp)
        for row in rows[~is_time(times_us)]
    }


def _keyframes(
    frames: Frames, samples: list[Sample], num_columns: int
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """[S, columns] frame of each sample's keyframe; and rivals of these, at other times.

    Of several the nearest in time to the sample is taken; of several at one time the last.
    """
    rows = np.flatnonzero(frames.is_key & (frames.channel != OTHER))
    places = frames.sample[rows] * num_columns + frames.channel[rows]
    num_places = len(samples) * num_columns
    if (np.bincount(places, minlength=num_places) > 1).any():
        sample_us = np.asarray([sample.timestamp for sample in samples], dtype=np.float64)
        away_us = np.abs(frames.time_us[rows] - np.nan_to_num(sample_us)[frames.sample[rows]])
        order = np.lexsort((rows, -away_us, places))
        rows, places = rows[order], places[order]
    keyframe = np.full(num_places, -1, dtype=np.int64)
    # Of several values for one place the last stays.
    keyframe[places] = rows
    rivals = rows[frames.time_us[rows] != frames.time_us[keyframe[places]]]
    return keyframe.reshape(len(samples), num_columns), rivals


def _tracks(
    time_s: FloatArray, scene: NDArray[np.int64], kept: NDArray[np.bool_], num_scenes: int
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """[P] frames by scene and time, of several at one time the last; [C + 1] where scenes start."""
    rows = np.flatnonzero(kept)
    rows = rows[np.lexsort((time_s[rows], scene[rows]))]
    is_last = np.ones(len(rows), dtype=bool)
    is_last[:-1] = (np.diff(time_s[rows]) != 0.0) | (np.diff(scene[rows]) != 0)
    rows = rows[is_last]
    counts = np.bincount(scene[rows], minlength=num_scenes)
    return rows, np.cumsum([0, *counts], dtype=np.int64)


def _used(frames: Frames, rows: NDArray[np.int64]) -> NDArray[np.int64]:
    """Calibrations of some frames; a row of -1 is none."""
    used: NDArray[np.int64] = np.unique(frames.calibration[rows[rows >= 0]])
    return used
