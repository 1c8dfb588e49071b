"""The sensor records that are wanted, of keyframes and of lidar sweeps, as arrays."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lss_core.data.tables.by_token import ByToken, rows_of
from lss_core.data.tables.file_names import leads_astray
from lss_core.data.tables.problems import Problem, is_side, is_time, problem_of, time_problem
from lss_core.data.tables.reading import (
    CalibratedSensor,
    Sample,
    SampleData,
    Sensor,
    read_pieces,
    table_path,
)
from lss_core.errors import DataError
from lss_core.geometry import FloatArray

# Columns of channels: the cameras' follow that of the lidar.
LIDAR, OTHER, _UNSEEN = 0, -1, -2


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


class FrameReader:
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
        self._sample_row = rows_of(folder, samples, SampleData)
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
        kept = np.flatnonzero((channel == LIDAR) | (is_key & (channel != OTHER)) | whole[sample])
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
                row: time_problem(self._folder, own[row], own[row].timestamp)
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
                self._column[row] = self.columns.get(name, OTHER)
            channel = self._column[calibration]
        return channel


def _shifted(parts: list[dict[int, Problem]], starts: list[int]) -> dict[int, Problem]:
    """Problems by row of the whole table rather than of its pieces."""
    return {
        start + row: problem
        for start, part in zip(starts, parts, strict=False)
        for row, problem in part.items()
    }
