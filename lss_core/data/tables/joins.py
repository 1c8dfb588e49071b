"""The nuScenes tables joined: tokens become rows of arrays, and what no index needs is dropped."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lss_core.data.tables.file_names import leads_astray
from lss_core.data.tables.problems import Problem, is_side, is_time, problem_of
from lss_core.data.tables.reading import (
    ByToken,
    CalibratedSensor,
    Log,
    Record,
    Sample,
    SampleData,
    Scene,
    Sensor,
    read_pieces,
    read_table,
    table_path,
)
from lss_core.data.tables.transforms import ego_poses, intrinsics, mountings
from lss_core.errors import DataError
from lss_core.geometry import FloatArray

# Columns of channels: the cameras' follow that of the lidar.
LIDAR, _OTHER, _UNSEEN = 0, -1, -2


@dataclass(frozen=True)
class Frames:
    """F sensor records, in the order of their table.

    Attributes:
        sample: [F] row of its sample.
        channel: [F] 0 for LIDAR_TOP, from 1 on for the cameras asked for, -1 for others.
        is_key: [F].
        time_us: [F] 0 if it is none.
        calibration: [F] row of its calibration.
        pose_token: Of the car at its time.
        filename: Of keyframes and LIDAR_TOP sweeps; empty for others.
        image_hw: [F, 2] 0 where the table has none.
        time_problems: What is wrong with the time, by frame.
        size_problems: What is wrong with the image size, by frame.
    """

    sample: NDArray[np.int64]
    channel: NDArray[np.int64]
    is_key: NDArray[np.bool_]
    time_us: FloatArray
    calibration: NDArray[np.int64]
    pose_token: list[str]
    filename: list[str]
    image_hw: NDArray[np.int64]
    time_problems: dict[int, Problem]
    size_problems: dict[int, Problem]


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
    scene_row = _rows_of(folder, scenes, Sample)
    sample_scene = np.asarray([scene_row[sample.scene_token] for sample in samples], dtype=np.int64)
    calibrations = read_table(folder, CalibratedSensor)
    reader = _FrameReader(folder, sensors, samples, calibrations, cameras)
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


def _rows_of(
    folder: Path, records: list[Scene] | list[Sample], asked_by: type[Record]
) -> ByToken[int]:
    """Rows of records by token, of which there is one each."""
    kind = type(records[0])
    pairs = ((record.token, row) for row, record in enumerate(records))
    rows = ByToken(folder, kind, asked_by, pairs)
    if len(rows) < len(records):
        double = next(r.token for row, r in enumerate(records) if rows[r.token] != row)
        raise DataError(
            f"The table '{table_path(folder, kind)}' has several records '{double}'; unpack it "
            "anew."
        )
    return rows


def _sample_problems(
    folder: Path, samples: list[Sample], lidar: NDArray[np.int64]
) -> dict[int, Problem]:
    """Of samples without a lidar keyframe: only theirs is the time of the sample."""
    rows = np.flatnonzero(lidar < 0)
    times_us = np.asarray([samples[row].timestamp for row in rows.tolist()], dtype=np.float64)
    return {
        int(row): _bad_time(folder, samples[row], samples[row].timestamp)
        for row in rows[~is_time(times_us)]
    }


def _bad_time(folder: Path, record: Record, time_us: float) -> Problem:
    flaw = f"timestamp {time_us:g} microseconds"
    return problem_of("impossible time stamp", folder, type(record), record.token, flaw)


class _FrameReader:
    """Reads the sensor records that are wanted."""

    def __init__(
        self,
        folder: Path,
        sensors: dict[str, str],
        samples: list[Sample],
        calibrations: list[CalibratedSensor],
        cameras: tuple[str, ...],
    ) -> None:
        self._folder = folder
        self._sensors = ByToken(folder, Sensor, CalibratedSensor, sensors.items())
        self._calibrations = calibrations
        self._sample_row = _rows_of(folder, samples, SampleData)
        self._calibration_row = ByToken(
            folder,
            CalibratedSensor,
            SampleData,
            ((record.token, row) for row, record in enumerate(calibrations)),
        )
        self._column = np.full(len(calibrations), _UNSEEN, dtype=np.int64)
        channels = dict.fromkeys(("LIDAR_TOP", *cameras))
        self.columns = {name: column for column, name in enumerate(channels)}

    def read(self, whole: NDArray[np.bool_]) -> Frames:
        """Keyframes and lidar sweeps; all frames of samples [S] that are wanted whole."""
        parts = [self._part(piece, whole) for piece in read_pieces(self._folder, SampleData)]
        starts = np.cumsum([0, *(len(part.sample) for part in parts)]).tolist()
        return Frames(
            sample=np.concatenate([part.sample for part in parts]),
            channel=np.concatenate([part.channel for part in parts]),
            is_key=np.concatenate([part.is_key for part in parts]),
            time_us=np.concatenate([part.time_us for part in parts]),
            calibration=np.concatenate([part.calibration for part in parts]),
            pose_token=[token for part in parts for token in part.pose_token],
            filename=[name for part in parts for name in part.filename],
            image_hw=np.concatenate([part.image_hw for part in parts]),
            time_problems=_shifted([part.time_problems for part in parts], starts),
            size_problems=_shifted([part.size_problems for part in parts], starts),
        )

    def _part(self, records: list[SampleData], whole: NDArray[np.bool_]) -> Frames:
        row_of, calibration_of = self._sample_row, self._calibration_row
        sample = np.asarray([row_of[r.sample_token] for r in records], dtype=np.int64)
        calibration = np.asarray(
            [calibration_of[r.calibrated_sensor_token] for r in records], dtype=np.int64
        )
        channel = self._channels(calibration)
        is_key = np.asarray([bool(r.is_key_frame) for r in records], dtype=bool)
        kept = np.flatnonzero((channel == LIDAR) | (is_key & (channel != _OTHER)) | whole[sample])
        own = [records[row] for row in kept.tolist()]
        channel, is_key = channel[kept], is_key[kept]
        opened = is_key | (channel == LIDAR)
        filename = [
            r.filename if is_opened else ""
            for r, is_opened in zip(own, opened.tolist(), strict=True)
        ]
        self._check_names(own, filename)
        time_us = np.asarray([r.timestamp for r in own], dtype=np.float64)
        image_hw = np.asarray([(r.height or 0, r.width or 0) for r in own], dtype=np.float64)
        image_hw = image_hw.reshape(-1, 2)
        # Sizes are of images that are looked at; a lidar may have what it likes.
        bad_size = is_key & (channel > LIDAR) & ~is_side(image_hw).all(axis=-1)
        bad_time = ~is_time(time_us)
        return Frames(
            sample=sample[kept],
            channel=channel,
            is_key=is_key,
            time_us=np.where(bad_time, 0.0, time_us),
            calibration=calibration[kept],
            pose_token=[r.ego_pose_token for r in own],
            filename=filename,
            image_hw=np.where(is_side(image_hw), image_hw, 0).astype(np.int64),
            time_problems={
                row: _bad_time(self._folder, own[row], own[row].timestamp)
                for row in np.flatnonzero(bad_time).tolist()
            },
            size_problems={
                row: self._bad_size(own[row]) for row in np.flatnonzero(bad_size).tolist()
            },
        )

    def _check_names(self, records: list[SampleData], names: list[str]) -> None:
        """Refuse a data set whose tables name files outside of it."""
        for record, name in zip(records, names, strict=True):
            if leads_astray(name):
                raise DataError(
                    f"The table '{table_path(self._folder, SampleData)}' is refused: the file name "
                    f"'{name}' of its record '{record.token}' leads out of the data root or has "
                    "characters that no file name should have."
                )

    def _bad_size(self, record: SampleData) -> Problem:
        flaw = f"width {record.width} and height {record.height}"
        return problem_of("impossible image size", self._folder, SampleData, record.token, flaw)

    def _channels(self, calibration: NDArray[np.int64]) -> NDArray[np.int64]:
        channel: NDArray[np.int64] = self._column[calibration]
        # Only calibrations that are used need a sensor.
        unseen = channel == _UNSEEN
        if unseen.any():
            for row in np.unique(calibration[unseen]):
                name = self._sensors[self._calibrations[row].sensor_token]
                self._column[row] = self.columns.get(name, _OTHER)
            channel = self._column[calibration]
        return channel


def _shifted(parts: list[dict[int, Problem]], starts: list[int]) -> dict[int, Problem]:
    """Problems by row of the whole table rather than of its pieces."""
    return {
        start + row: problem
        for start, part in zip(starts, parts, strict=False)
        for row, problem in part.items()
    }


def _keyframes(
    frames: Frames, samples: list[Sample], num_columns: int
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """[S, columns] frame of each sample's keyframe; and rivals of these, at other times.

    Of several the nearest in time to the sample is taken; of several at one time the last.
    """
    rows = np.flatnonzero(frames.is_key & (frames.channel != _OTHER))
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
