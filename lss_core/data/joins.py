"""The nuScenes tables joined: tokens become rows of arrays, and what no index needs is dropped."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lss_core.data.tables import (
    CalibratedSensor,
    EgoPose,
    Log,
    Sample,
    SampleData,
    Scene,
    Sensor,
    read_pieces,
    read_table,
)
from lss_core.errors import DataError
from lss_core.geometry import FloatArray, rigid_from_quaternion

# Columns of channels: the cameras' follow that of the lidar.
LIDAR, _OTHER, _UNSEEN = 0, -1, -2


@dataclass(frozen=True)
class Frames:
    """F sensor records, in the order of their table.

    Attributes:
        sample: [F] row of its sample.
        channel: [F] 0 for LIDAR_TOP, from 1 on for the cameras asked for, -1 for others.
        is_key: [F].
        time_us: [F].
        calibration: [F] row of its calibration.
        pose_token: Of the car at its time.
        filename: Of keyframes and LIDAR_TOP sweeps; empty for others.
        image_hw: [F, 2] 0 where the table has none.
    """

    sample: NDArray[np.int64]
    channel: NDArray[np.int64]
    is_key: NDArray[np.bool_]
    time_us: FloatArray
    calibration: NDArray[np.int64]
    pose_token: list[str]
    filename: list[str]
    image_hw: NDArray[np.int64]


@dataclass(frozen=True)
class JoinedTables:
    """What the tables say of C scenes, S samples and F frames.

    Attributes:
        scenes: C records.
        locations: Where each scene was.
        samples: S records.
        sample_scene: [S] row of its scene.
        frames: Keyframes of the cameras asked for and all LIDAR_TOP sweeps; all frames of scenes
            without any.
        global_from_ego: [F, 4, 4] the car at each frame.
        ego_from_sensor: [K, 4, 4] mounting of each calibration; zero if no keyframe has it.
        rawpixel_from_camera: [K, 3, 3] of each calibration; zero if no camera's keyframe has it.
        lidar: [S] frame of its LIDAR_TOP keyframe; -1 where there is none.
        images: [S, N] frame of its keyframe of each camera; -1 where there is none.
        track: [P] frames whose poses are the tracks of the scenes, one scene after the other, each
            increasing in time.
        track_start: [C + 1] where each scene's begin in `track`.
    """

    scenes: list[Scene]
    locations: list[str]
    samples: list[Sample]
    sample_scene: NDArray[np.int64]
    frames: Frames
    global_from_ego: FloatArray
    ego_from_sensor: FloatArray
    rawpixel_from_camera: FloatArray
    lidar: NDArray[np.int64]
    images: NDArray[np.int64]
    track: NDArray[np.int64]
    track_start: NDArray[np.int64]


def join_tables(folder: Path, cameras: tuple[str, ...]) -> JoinedTables:
    """Read the tables of a version's folder and follow their tokens.

    Args:
        folder: Holds the tables.
        cameras: Channels whose keyframes are wanted.

    Raises:
        DataError: If a table cannot be read, a camera is unknown, there is no sample, a token leads
            nowhere or a number is none.
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
    try:
        return _join(folder, cameras, sensors, scenes, samples)
    except KeyError as error:
        raise DataError(
            f"The tables of '{folder}' do not fit together: no record {error}."
        ) from error
    except (ValueError, OverflowError) as error:
        raise DataError(f"The tables of '{folder}' hold a bad number: {error}") from error


def _join(
    folder: Path,
    cameras: tuple[str, ...],
    sensors: dict[str, str],
    scenes: list[Scene],
    samples: list[Sample],
) -> JoinedTables:
    location = {log.token: log.location for log in read_table(folder, Log)}
    scene_row = {scene.token: row for row, scene in enumerate(scenes)}
    sample_scene = np.asarray([scene_row[sample.scene_token] for sample in samples], dtype=np.int64)
    calibrations = read_table(folder, CalibratedSensor)
    reader = _FrameReader(folder, sensors, samples, calibrations, cameras)
    frames = reader.read(np.zeros(len(samples), dtype=bool))
    has_lidar = np.zeros(len(scenes), dtype=bool)
    has_lidar[sample_scene[frames.sample[frames.channel == LIDAR]]] = True
    if not has_lidar[sample_scene].all():
        frames = reader.read(~has_lidar[sample_scene])
    keyframe = _keyframes(frames, len(samples), len(reader.columns))
    images = keyframe[:, [reader.columns[camera] for camera in cameras]]
    track, track_start = _tracks(frames, sample_scene, has_lidar)
    return JoinedTables(
        scenes=scenes,
        locations=[location[scene.log_token] for scene in scenes],
        samples=samples,
        sample_scene=sample_scene,
        frames=frames,
        global_from_ego=_poses(folder, frames.pose_token),
        ego_from_sensor=_mountings(calibrations, _used(frames, keyframe)),
        rawpixel_from_camera=_intrinsics(calibrations, _used(frames, images)),
        lidar=keyframe[:, LIDAR],
        images=images,
        track=track,
        track_start=track_start,
    )


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
        self._sensors = sensors
        self._calibrations = calibrations
        self._sample_row = {sample.token: row for row, sample in enumerate(samples)}
        self._calibration_row = {record.token: row for row, record in enumerate(calibrations)}
        self._column = np.full(len(calibrations), _UNSEEN, dtype=np.int64)
        channels = dict.fromkeys(("LIDAR_TOP", *cameras))
        self.columns = {name: column for column, name in enumerate(channels)}

    def read(self, whole: NDArray[np.bool_]) -> Frames:
        """Keyframes and lidar sweeps; all frames of samples [S] that are wanted whole."""
        parts = [self._part(piece, whole) for piece in read_pieces(self._folder, SampleData)]
        return Frames(
            sample=np.concatenate([part.sample for part in parts]),
            channel=np.concatenate([part.channel for part in parts]),
            is_key=np.concatenate([part.is_key for part in parts]),
            time_us=np.concatenate([part.time_us for part in parts]),
            calibration=np.concatenate([part.calibration for part in parts]),
            pose_token=[token for part in parts for token in part.pose_token],
            filename=[name for part in parts for name in part.filename],
            image_hw=np.concatenate([part.image_hw for part in parts]),
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
        return Frames(
            sample=sample[kept],
            channel=channel[kept],
            is_key=is_key[kept],
            time_us=np.asarray([r.timestamp for r in own], dtype=np.float64),
            calibration=calibration[kept],
            pose_token=[r.ego_pose_token for r in own],
            filename=[
                r.filename if r.is_key_frame or is_lidar else ""
                for r, is_lidar in zip(own, (channel[kept] == LIDAR).tolist(), strict=True)
            ],
            image_hw=np.asarray(
                [(int(r.height or 0), int(r.width or 0)) for r in own], dtype=np.int64
            ).reshape(-1, 2),
        )

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


def _keyframes(frames: Frames, num_samples: int, num_columns: int) -> NDArray[np.int64]:
    """[S, columns] frame of each sample's keyframe; the last one if there are more."""
    rows = np.flatnonzero(frames.is_key & (frames.channel != _OTHER))
    keyframe = np.full((num_samples, num_columns), -1, dtype=np.int64)
    np.maximum.at(keyframe, (frames.sample[rows], frames.channel[rows]), rows)
    return keyframe


def _tracks(
    frames: Frames, sample_scene: NDArray[np.int64], has_lidar: NDArray[np.bool_]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """[P] frames by scene and time, of several at one time the last; [C + 1] where scenes start."""
    scene, time_s = sample_scene[frames.sample], frames.time_us / 1e6
    rows = np.flatnonzero((frames.channel == LIDAR) | ~has_lidar[scene])
    rows = rows[np.lexsort((time_s[rows], scene[rows]))]
    is_last = np.ones(len(rows), dtype=bool)
    is_last[:-1] = (np.diff(time_s[rows]) != 0.0) | (np.diff(scene[rows]) != 0)
    rows = rows[is_last]
    counts = np.bincount(scene[rows], minlength=len(has_lidar))
    return rows, np.cumsum([0, *counts], dtype=np.int64)


def _used(frames: Frames, rows: NDArray[np.int64]) -> NDArray[np.int64]:
    """Calibrations of some frames; a row of -1 is none."""
    used: NDArray[np.int64] = np.unique(frames.calibration[rows[rows >= 0]])
    return used


def _mountings(calibrations: list[CalibratedSensor], used: NDArray[np.int64]) -> FloatArray:
    """[K, 4, 4] of those calibrations that are used; zero for others, which may hold anything."""
    mountings = np.zeros((len(calibrations), 4, 4))
    if len(used):
        mountings[used] = rigid_from_quaternion(
            np.asarray([calibrations[row].translation for row in used]),
            np.asarray([calibrations[row].rotation for row in used]),
        )
    return mountings


def _intrinsics(calibrations: list[CalibratedSensor], used: NDArray[np.int64]) -> FloatArray:
    """[K, 3, 3] of those calibrations that are used; zero for others."""
    intrinsics = np.zeros((len(calibrations), 3, 3))
    for row in used:
        matrix = calibrations[row].camera_intrinsic or []
        if [len(line) for line in matrix] != [3, 3, 3]:
            raise ValueError(
                f"camera_intrinsic of '{calibrations[row].token}' must be three rows of three."
            )
        intrinsics[row] = matrix
    return intrinsics


def _poses(folder: Path, tokens: list[str]) -> FloatArray:
    """[F, 4, 4] ego poses of frames, by their tokens."""
    slot: dict[str, int] = {}
    slots = [slot.setdefault(token, len(slot)) for token in tokens]
    translation_m, quaternion = np.zeros((len(slot), 3)), np.zeros((len(slot), 4))
    found = np.zeros(len(slot), dtype=bool)
    for piece in read_pieces(folder, EgoPose):
        own = [record for record in piece if record.token in slot]
        if own:
            rows = [slot[record.token] for record in own]
            translation_m[rows] = [record.translation for record in own]
            quaternion[rows] = [record.rotation for record in own]
            found[rows] = True
    if not found.all():
        raise KeyError(list(slot)[int(found.argmin())])
    poses: FloatArray = rigid_from_quaternion(translation_m, quaternion)[slots]
    return poses
