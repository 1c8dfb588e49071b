"""Drives cut into scenes with keyframes, and all of them written as one data set."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from lss_core.data.converters.drive import Drive, FoundDrive, SeenBox, nearest
from lss_core.data.writing.scene_writer import SceneWriter
from lss_core.data.writing.tables_writer import TablesWriter
from lss_core.errors import DataError
from lss_core.geometry import FloatArray, interpolate_poses
from lss_core.progress import progress

SCENE_S = 20.0
KEYFRAME_S = 0.5
# What was taken further off is not of that moment.
_NEAR_S = 0.1
# Without a choice of the user or of the publishers the last of so many logs is for validation.
_LOGS_A_VAL = 5


class Written(NamedTuple):
    """A data set that was written.

    Attributes:
        folder: Of its tables.
        cameras: Its channels, in the order of the first drive that has them.
    """

    folder: Path
    cameras: tuple[str, ...]


class _Moment(NamedTuple):
    """A keyframe to be: its time, and by channel an image and when it was taken."""

    time_s: float
    images: dict[str, tuple[Path, float]]


def write_drives(drives: Sequence[FoundDrive], out: Path, val: Sequence[str] = ()) -> Written:
    """Write drives as a data set, cut into scenes of about 20 s with a keyframe every 0.5 s.

    The tables appear at the end, all at once. What a killed call has linked or written of images
    and sweeps is found again by the next.

    Args:
        drives: One or more, of names of their own.
        out: Folder of the data set.
        val: Logs for validation; the others are for training. If none is named, the publishers'
            splits hold, and where they made none every fifth log, in the order of names, is for
            validation, or the last one of fewer than five.

    Raises:
        DataError: If `val` names a log that is not there, a drive is not as its data set's are, or
            the data set is there already.
        OSError: If a file cannot be read or written.
    """
    split_of = _splits(drives, val)
    writer = TablesWriter(out)
    splits: dict[str, list[str]] = {}
    cameras: dict[str, None] = {}
    with progress("Drives", len(drives)) as advance:
        for found in drives:
            try:
                drive = found.read()
                names = _add_drive(writer, found, drive)
            except (ValueError, LookupError) as error:
                raise DataError(f"'{found.name}' cannot be read: {error}.") from error
            splits.setdefault(split_of[found.whole], []).extend(names)
            cameras |= dict.fromkeys(drive.cameras)
            advance(1)
    # Train before val, as people read them.
    folder = writer.write({name: splits[name] for name in sorted(splits)})
    return Written(folder, tuple(cameras))


def _splits(drives: Sequence[FoundDrive], val: Sequence[str]) -> dict[str, str]:
    """Log -> split."""
    logs = {found.whole: found.split for found in drives}
    unknown = [name for name in val if name not in logs]
    if unknown:
        known = ", ".join(sorted(logs))
        raise DataError(f"--val names '{unknown[0]}', which is not there; there are {known}.")
    if val:
        return {log: "val" if log in val else "train" for log in logs}
    unsplit = sorted(log for log, split in logs.items() if not split)
    chosen = unsplit[_LOGS_A_VAL - 1 :: _LOGS_A_VAL] or unsplit[-1:]
    return {log: split or ("val" if log in chosen else "train") for log, split in logs.items()}


def _add_drive(writer: TablesWriter, found: FoundDrive, drive: Drive) -> list[str]:
    """Add its scenes; returns their names."""
    time_s = drive.time_s
    if len(time_s) < 2:
        raise DataError(f"'{found.name}' has {len(time_s)} poses; a drive has two or more.")
    num_scenes = max(1, round((time_s[-1] - time_s[0]) / SCENE_S))
    ends_s = np.linspace(time_s[0], time_s[-1], num_scenes + 1)[1:-1]
    names = []
    parts = np.split(np.arange(len(time_s)), np.searchsorted(time_s, ends_s))
    for number, rows in enumerate(parts):
        moments = _moments(drive, time_s[rows])
        if not moments:
            continue
        names.append(f"{found.name}-{number:02d}")
        poses = drive.global_from_ego[rows]
        scene = writer.add_scene(names[-1], time_s[rows], poses, log=found.whole)
        _add_sensors(scene, drive, moments, time_s[rows])
        _add_boxes(scene, drive.boxes, moments, time_s[rows], poses)
    if not names:
        raise DataError(
            f"'{found.name}' has no image within the time of its poses; are its clocks the same?"
        )
    return names


def _moments(drive: Drive, time_s: FloatArray) -> list[_Moment]:
    """Keyframes of a scene, with what was taken about then; one without anything is none."""
    keyframes_s = _keyframes(drive.moments_s, time_s)
    chosen: list[dict[str, tuple[Path, float]]] = [{} for _ in keyframes_s]
    for channel, camera in drive.cameras.items():
        # The car must be known where an image was taken, too.
        inside = np.flatnonzero((camera.time_s >= time_s[0]) & (camera.time_s <= time_s[-1]))
        if not len(inside):
            continue
        rows = inside[nearest(camera.time_s[inside], keyframes_s)]
        for images, row, moment_s in zip(chosen, rows.tolist(), keyframes_s, strict=True):
            if abs(camera.time_s[row] - moment_s) <= _NEAR_S:
                images[channel] = (camera.files[row], float(camera.time_s[row]))
    return [
        _Moment(moment_s, images)
        for moment_s, images in zip(keyframes_s.tolist(), chosen, strict=True)
        if images or drive.sweeps is not None
    ]


def _keyframes(moments_s: FloatArray, time_s: FloatArray) -> FloatArray:
    """Moments within a scene's poses, about every 0.5 s."""
    inside: FloatArray = moments_s[(moments_s >= time_s[0]) & (moments_s <= time_s[-1])]
    if not len(inside):
        return inside
    wanted_s = np.arange(inside[0], inside[-1] + _NEAR_S, KEYFRAME_S)
    rows = np.unique(nearest(inside, wanted_s))
    off_s = np.abs(inside[rows] - wanted_s[nearest(wanted_s, inside[rows])])
    chosen: FloatArray = inside[rows[off_s <= _NEAR_S]]
    return chosen


def _add_sensors(
    scene: SceneWriter, drive: Drive, moments: Sequence[_Moment], time_s: FloatArray
) -> None:
    # Sweeps of the scene that no keyframe has taken yet, by their times.
    left: dict[float, int] = {}
    if drive.sweeps is not None:
        scene.add_lidar(drive.sweeps.ego_from_lidar)
        swept_s = drive.sweeps.time_s
        inside = np.flatnonzero((swept_s >= time_s[0]) & (swept_s <= time_s[-1]))
        left = dict(zip(swept_s[inside].tolist(), inside.tolist(), strict=True))
    for channel, camera in drive.cameras.items():
        scene.add_camera(
            channel, camera.rawpixel_from_camera, camera.ego_from_camera, camera.image_hw
        )
    for moment in moments:
        files = {channel: file for channel, (file, _) in moment.images.items()}
        times_s = {channel: taken_s for channel, (_, taken_s) in moment.images.items()}
        sweep = None if drive.sweeps is None else drive.sweeps.load(left.pop(moment.time_s))
        scene.add_keyframe(moment.time_s, files, times_s, sweep)
    if drive.sweeps is not None:
        for sweep_s, number in left.items():
            scene.add_sweep(sweep_s, drive.sweeps.load(number))


def _add_boxes(
    scene: SceneWriter,
    boxes: Sequence[SeenBox],
    moments: Sequence[_Moment],
    time_s: FloatArray,
    global_from_ego: FloatArray,
) -> None:
    moments_s = [moment.time_s for moment in moments]
    poses = interpolate_poses(time_s, global_from_ego, np.array(moments_s))
    global_from_ego_at = dict(zip(moments_s, poses, strict=True))
    for box in boxes:
        pose = global_from_ego_at.get(box.time_s)
        if pose is not None:
            global_from_box = pose @ box.ego_from_box
            scene.add_box(box.time_s, box.instance, box.category, box.size_m, global_from_box)
