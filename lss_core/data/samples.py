"""The nuScenes tables, walked once: a compact index of samples, cameras, poses and scenes.

Opening the devkit on the full data set takes most of a minute and gigabytes; the index keeps what
training needs as plain arrays and is cached, keyed by the size and time stamp of every table.
"""

import hashlib
import json
import logging
import os
from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from lss_core.data.splits import scenes_of_split
from lss_core.errors import DataError
from lss_core.files import write_atomically
from lss_core.geometry import FloatArray, interpolate_poses, rigid_from_quaternion

logger = logging.getLogger(__name__)

_FORMAT = 1
_TABLES = (
    "calibrated_sensor",
    "ego_pose",
    "log",
    "sample",
    "sample_data",
    "scene",
    "sensor",
)
LIDAR = "LIDAR_TOP"


# Texts are annotated `np.character`: checked at run time, `np.str_` stands for empty texts only.
@dataclass(frozen=True)
class SampleIndex:
    """What is known of S samples, N cameras, C scenes and P ego poses, without opening the tables.

    The ego frame of a sample is that of its keyframe LIDAR_TOP sweep (of the sample's own time
    stamp in scenes without lidar). Poses of a scene c are rows `track_start[c]:track_start[c + 1]`,
    one per LIDAR_TOP sweep, increasing in time.

    Attributes:
        cameras: [N] channel names.
        sample_token: [S].
        sample_scene: [S] row of its scene.
        time_s: [S] time of the ego frame.
        global_from_ego: [S, 4, 4].
        has_camera: [S, N] whether the sample has a keyframe image of this camera in the tables.
        image_path: [S, N] relative to the data root; empty where there is none.
        image_hw: [S, N, 2] image size according to the tables.
        rawpixel_from_camera: [S, N, 3, 3] intrinsics of the image on disk.
        egocam_from_camera: [S, N, 4, 4] mounting.
        global_from_egocam: [S, N, 4, 4] the car at the camera's own time.
        camera_time_s: [S, N].
        lidar_path: [S] keyframe sweep, relative to the data root; empty where there is none.
        ego_from_lidar: [S, 4, 4] mounting.
        scene_name: [C].
        scene_token: [C].
        scene_description: [C].
        scene_location: [C].
        track_start: [C + 1].
        track_time_s: [P].
        track_xy_m: [P, 2] ego origin in `global`.
        track_yaw_rad: [P] heading in `global`.
    """

    cameras: NDArray[np.character]
    sample_token: NDArray[np.character]
    sample_scene: NDArray[np.int64]
    time_s: FloatArray
    global_from_ego: FloatArray
    has_camera: NDArray[np.bool_]
    image_path: NDArray[np.character]
    image_hw: NDArray[np.int64]
    rawpixel_from_camera: FloatArray
    egocam_from_camera: FloatArray
    global_from_egocam: FloatArray
    camera_time_s: FloatArray
    lidar_path: NDArray[np.character]
    ego_from_lidar: FloatArray
    scene_name: NDArray[np.character]
    scene_token: NDArray[np.character]
    scene_description: NDArray[np.character]
    scene_location: NDArray[np.character]
    track_start: NDArray[np.int64]
    track_time_s: FloatArray
    track_xy_m: FloatArray
    track_yaw_rad: FloatArray

    def track(self, scene: int) -> slice:
        """Rows of a scene's poses."""
        return slice(int(self.track_start[scene]), int(self.track_start[scene + 1]))

    def row_of(self, token: str) -> int:
        """Row of a sample.

        Raises:
            DataError: If no sample has this token.
        """
        rows = np.flatnonzero(self.sample_token == token)
        if not len(rows):
            raise DataError(f"No sample has the token '{token}' in this data set.")
        return int(rows[0])


def load_index(root: str | Path, version: str, cameras: Iterable[str]) -> SampleIndex:
    """The index of a data set, from the cache if the tables have not changed since.

    Args:
        root: Folder that holds the version's folder.
        version: Name of the tables' folder, as `v1.0-trainval`.
        cameras: Channels to index, in this order.

    Raises:
        DataError: If the folder, the version, a table or a camera is missing or unreadable.
    """
    root = Path(root)
    cameras = tuple(cameras)
    tables = _check_tables(root, version)
    stamp = [str(root.resolve()), version, _FORMAT, cameras]
    for table in tables:
        stat = table.stat()
        stamp += [table.name, stat.st_size, stat.st_mtime_ns]
    key = hashlib.sha256(json.dumps(stamp).encode()).hexdigest()[:24]
    cache = _cache_folder() / f"index-{key}.npz"
    if cache.exists():
        try:
            with np.load(cache, allow_pickle=False) as stored:
                return SampleIndex(**{f.name: stored[f.name] for f in fields(SampleIndex)})
        except (OSError, EOFError, ValueError, KeyError, BadZipFile) as error:
            logger.warning(
                "The cached index %s is unreadable (%s); building it anew.", cache, error
            )
    index = _build_index(root, version, cameras)
    try:
        with write_atomically(cache) as stream:
            np.savez(stream, **{f.name: getattr(index, f.name) for f in fields(SampleIndex)})
    except OSError as error:
        logger.warning("The index could not be cached in %s: %s.", cache, error)
    return index


def rows_of_split(
    index: SampleIndex, root: str | Path, version: str, split: str
) -> NDArray[np.int64]:
    """Rows of the samples whose scene belongs to a split, in the order of scenes and times.

    Raises:
        DataError: If the split is unknown or none of its scenes is in the data set.
    """
    names = scenes_of_split(Path(root) / version, split)
    wanted = np.isin(index.scene_name, list(names))
    rows = np.flatnonzero(wanted[index.sample_scene])
    if not len(rows):
        raise DataError(
            f"None of the {len(names)} scenes of split '{split}' is in {Path(root) / version}; "
            "check the version and the split."
        )
    order = np.lexsort((index.time_s[rows], index.sample_scene[rows]))
    ordered: NDArray[np.int64] = rows[order]
    return ordered


def _cache_folder() -> Path:
    override = os.environ.get("SHOOT_CACHE")
    if override:
        return Path(override)
    return Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "shoot"


def _check_tables(root: Path, version: str) -> list[Path]:
    if not root.is_dir():
        raise DataError(f"The data root '{root}' is not a folder; point --data.root at nuScenes.")
    folder = root / version
    if not folder.is_dir():
        found = sorted(p.parent.name for p in root.glob("*/sample_data.json"))
        hint = f"found {', '.join(found)}" if found else "no version with tables is there"
        raise DataError(f"There is no version '{version}' in '{root}' ({hint}).")
    tables = [folder / f"{name}.json" for name in _TABLES]
    missing = [table.name for table in tables if not table.is_file()]
    if missing:
        raise DataError(
            f"The version folder '{folder}' lacks {', '.join(missing)}; "
            "is the data set unpacked and written to its end?"
        )
    return tables


def _open_devkit(root: Path, version: str) -> Any:
    from nuscenes.nuscenes import NuScenes  # slow to import and needed once per data set

    try:
        return NuScenes(version, dataroot=str(root), verbose=False)
    except (AssertionError, LookupError, TypeError, ValueError, OSError) as error:
        raise DataError(
            f"nuscenes-devkit cannot open '{root / version}': {type(error).__name__}: {error}"
            f"{_unreadable_tables(root / version)}."
        ) from error


def _unreadable_tables(folder: Path) -> str:
    """Which tables are no JSON: the devkit does not say."""
    broken = []
    for table in sorted(folder.glob("*.json")):
        try:
            json.loads(table.read_bytes())
        except ValueError:
            broken.append(table.name)
    return f"; damaged: {', '.join(broken)}" if broken else ""


def _build_index(root: Path, version: str, cameras: tuple[str, ...]) -> SampleIndex:
    logger.info("Reading the tables of %s (once; the index is cached).", root / version)
    nusc = _open_devkit(root, version)
    known = {sensor["channel"] for sensor in nusc.sensor}
    unknown = [camera for camera in cameras if camera not in known]
    if unknown:
        raise DataError(
            f"The data set '{root / version}' has no sensor {', '.join(unknown)}; "
            f"it has {', '.join(sorted(known))}."
        )
    scenes = nusc.scene
    if not scenes or not nusc.sample:
        raise DataError(f"The tables of '{root / version}' hold no scene with samples.")
    scene_row = {scene["token"]: row for row, scene in enumerate(scenes)}
    keyframe: dict[tuple[str, str], Any] = {}
    sweeps: dict[str, list[Any]] = defaultdict(list)
    others: dict[str, list[Any]] = defaultdict(list)
    scene_of_sample = {sample["token"]: sample["scene_token"] for sample in nusc.sample}
    try:
        for record in nusc.sample_data:
            scene = scene_of_sample[record["sample_token"]]
            (sweeps if record["channel"] == LIDAR else others)[scene].append(record)
            if record["is_key_frame"]:
                keyframe[record["sample_token"], record["channel"]] = record
        tracks = [_track(nusc, sweeps[s["token"]] or others[s["token"]]) for s in scenes]
        return _gather(nusc, cameras, scene_row, keyframe, tracks)
    except KeyError as error:
        raise DataError(
            f"The tables of '{root / version}' do not fit together: no record {error}."
        ) from error
    except ValueError as error:
        raise DataError(f"The tables of '{root / version}' hold a bad number: {error}") from error


@dataclass(frozen=True)
class _Track:
    time_s: FloatArray
    global_from_ego: FloatArray


def _track(nusc: Any, records: list[Any]) -> _Track:
    by_time = {record["timestamp"]: record["ego_pose_token"] for record in records}
    if not by_time:
        return _Track(np.zeros(0), np.zeros((0, 4, 4)))
    times = sorted(by_time)
    poses = [nusc.get("ego_pose", by_time[time]) for time in times]
    return _Track(np.asarray(times, dtype=np.float64) / 1e6, _rigid(poses))


def _rigid(records: list[Any]) -> FloatArray:
    return rigid_from_quaternion(
        np.asarray([record["translation"] for record in records], dtype=np.float64),
        np.asarray([record["rotation"] for record in records], dtype=np.float64),
    )


def _gather(
    nusc: Any,
    cameras: tuple[str, ...],
    scene_row: dict[str, int],
    keyframe: dict[tuple[str, str], Any],
    tracks: list[_Track],
) -> SampleIndex:
    samples = [
        sample for sample in nusc.sample if len(tracks[scene_row[sample["scene_token"]]].time_s)
    ]
    num, width = len(samples), len(cameras)
    eye = np.eye(4)
    sample_scene = np.asarray([scene_row[s["scene_token"]] for s in samples], dtype=np.int64)
    time_s = np.zeros(num)
    global_from_ego = np.tile(eye, (num, 1, 1))
    ego_from_lidar = np.tile(eye, (num, 1, 1))
    lidar_path = [""] * num
    has_camera = np.zeros((num, width), dtype=bool)
    image_path = [[""] * width for _ in range(num)]
    image_hw = np.zeros((num, width, 2), dtype=np.int64)
    intrinsics = np.tile(np.eye(3), (num, width, 1, 1))
    egocam_from_camera = np.tile(eye, (num, width, 1, 1))
    global_from_egocam = np.tile(eye, (num, width, 1, 1))
    camera_time_s = np.zeros((num, width))
    for row, sample in enumerate(samples):
        lidar = keyframe.get((sample["token"], LIDAR))
        if lidar is not None:
            time_s[row] = lidar["timestamp"] / 1e6
            global_from_ego[row] = _rigid([nusc.get("ego_pose", lidar["ego_pose_token"])])[0]
            mounting = nusc.get("calibrated_sensor", lidar["calibrated_sensor_token"])
            ego_from_lidar[row] = _rigid([mounting])[0]
            lidar_path[row] = lidar["filename"]
        else:
            track = tracks[sample_scene[row]]
            time_s[row] = np.clip(sample["timestamp"] / 1e6, track.time_s[0], track.time_s[-1])
            global_from_ego[row] = interpolate_poses(
                track.time_s, track.global_from_ego, time_s[row : row + 1]
            )[0]
        for column, channel in enumerate(cameras):
            image = keyframe.get((sample["token"], channel))
            if image is None:
                camera_time_s[row, column] = time_s[row]
                continue
            calibration = nusc.get("calibrated_sensor", image["calibrated_sensor_token"])
            has_camera[row, column] = True
            image_path[row][column] = image["filename"]
            image_hw[row, column] = image.get("height") or 0, image.get("width") or 0
            intrinsics[row, column] = calibration["camera_intrinsic"]
            egocam_from_camera[row, column] = _rigid([calibration])[0]
            pose = nusc.get("ego_pose", image["ego_pose_token"])
            global_from_egocam[row, column] = _rigid([pose])[0]
            camera_time_s[row, column] = image["timestamp"] / 1e6
    poses = np.concatenate([track.global_from_ego for track in tracks])
    return SampleIndex(
        cameras=np.asarray(cameras),
        sample_token=np.asarray([sample["token"] for sample in samples]),
        sample_scene=sample_scene,
        time_s=time_s,
        global_from_ego=global_from_ego,
        has_camera=has_camera,
        image_path=np.asarray(image_path).reshape(num, width),
        image_hw=image_hw,
        rawpixel_from_camera=intrinsics,
        egocam_from_camera=egocam_from_camera,
        global_from_egocam=global_from_egocam,
        camera_time_s=camera_time_s,
        lidar_path=np.asarray(lidar_path),
        ego_from_lidar=ego_from_lidar,
        scene_name=np.asarray([scene["name"] for scene in nusc.scene]),
        scene_token=np.asarray([scene["token"] for scene in nusc.scene]),
        scene_description=np.asarray([scene["description"] for scene in nusc.scene]),
        scene_location=np.asarray(
            [nusc.get("log", scene["log_token"])["location"] for scene in nusc.scene]
        ),
        track_start=np.cumsum([0, *(len(track.time_s) for track in tracks)]),
        track_time_s=np.concatenate([track.time_s for track in tracks]),
        track_xy_m=poses[:, :2, 3],
        track_yaw_rad=np.arctan2(poses[:, 1, 0], poses[:, 0, 0]),
    )
