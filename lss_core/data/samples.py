"""An index of samples, cameras, poses and scenes: what training needs of the nuScenes tables.

The tables are walked once per data set; the index is kept on disk, under the size and time stamp of
every table, and mapped from there: processes that use it share its memory.
"""

import hashlib
import json
import logging
import os
from collections.abc import Iterable
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lss_core.data.checks.sample_problems import find_problems
from lss_core.data.splits import has_own_splits, scenes_of_split
from lss_core.data.tables.array_file import map_arrays, save_arrays
from lss_core.data.tables.joins import LIDAR, JoinedTables, join_tables
from lss_core.data.tables.problems import Problem
from lss_core.data.tables.reading import TABLES
from lss_core.errors import DataError
from lss_core.geometry import FloatArray, interpolate_poses, yaw_of
from lss_core.legible import legible

logger = logging.getLogger(__name__)

_FORMAT = 6
# Letters of a description that are kept: one long text would make all of them as wide.
_SHOWN = 1000
# Time stamps are whole microseconds but travel as float64 seconds since 1970.
TIME_TOLERANCE_S = 1e-6


# Texts are annotated `np.character`: checked at run time, `np.str_` stands for empty texts only.
@dataclass(frozen=True)
class SampleIndex:
    """What is known of S samples, N cameras, C scenes and P ego poses, without opening the tables.

    The ego frame of a sample is that of its keyframe LIDAR_TOP sweep (of the sample's own time
    stamp in scenes without lidar). Poses of a scene c are rows `track_start[c]:track_start[c + 1]`,
    one per LIDAR_TOP sweep, increasing in time. What has a problem is not to be used; its numbers
    do no harm and mean nothing.

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
        scene_log: [C] token of the drive it was cut from.
        track_start: [C + 1].
        track_time_s: [P].
        track_xy_m: [P, 2] ego origin in `global`.
        track_yaw_rad: [P] heading in `global`.
        global_from_track: [P, 4, 4] the car at each pose.
        sweep_path: [P] the pose's LIDAR_TOP sweep, relative to the data root, in UTF-8; empty in
            scenes without lidar.
        problem_reason: [Q] kinds of problems; the first is none.
        problem_text: [Q] what is wrong, by file and record; the first is empty.
        scene_problem: [C] which of them a scene's poses have.
        camera_problem: [S, N] which of them calibration, pose or size of an image have.
        lidar_problem: [S] which of them the mounting of the lidar has.
        warning_reason: [W] kinds of what may be meant, but looks like a mistake.
        warning_text: [W] what that is, with counts over the whole data set.
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
    scene_log: NDArray[np.character]
    track_start: NDArray[np.int64]
    track_time_s: FloatArray
    track_xy_m: FloatArray
    track_yaw_rad: FloatArray
    global_from_track: FloatArray
    sweep_path: NDArray[np.character]
    problem_reason: NDArray[np.character]
    problem_text: NDArray[np.character]
    scene_problem: NDArray[np.int64]
    camera_problem: NDArray[np.int64]
    lidar_problem: NDArray[np.int64]
    warning_reason: NDArray[np.character]
    warning_text: NDArray[np.character]

    def problem(self, number: int) -> Problem:
        """The problem of this number, which is not 0."""
        return Problem(str(self.problem_reason[number]), str(self.problem_text[number]))

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

    What looks like a mistake but may be meant is logged each time.

    Args:
        root: Folder that holds the version's folder.
        version: Name of the tables' folder, as `v1.0-trainval`.
        cameras: Channels to index, in this order.

    Raises:
        DataError: If the folder, the version, a table or a camera is missing or unreadable.
    """
    index = _cached_index(Path(root), version, tuple(cameras))
    for text in index.warning_text.tolist():
        logger.warning("%s.", legible(text))
    return index


def _cached_index(root: Path, version: str, cameras: tuple[str, ...]) -> SampleIndex:
    tables = _check_tables(root, version)
    stamp = [str(root.resolve()), version, _FORMAT, cameras]
    for table in tables:
        stat = table.stat()
        stamp += [table.name, stat.st_size, stat.st_mtime_ns]
    key = hashlib.sha256(json.dumps(stamp).encode()).hexdigest()[:24]
    cache = _cache_folder() / f"index-{key}.arrays"
    if cache.exists():
        try:
            return SampleIndex(**map_arrays(cache))
        except (OSError, ValueError, TypeError) as error:
            logger.warning(
                "The cached index %s is unreadable (%s); building it anew.", cache, error
            )
    index = _build_index(root, version, cameras)
    try:
        save_arrays(cache, {f.name: getattr(index, f.name) for f in fields(SampleIndex)})
        # The memory of the mapped one is shared.
        return SampleIndex(**map_arrays(cache))
    except (OSError, ValueError) as error:
        logger.warning("The index could not be cached in %s: %s.", cache, error)
        return index


def rows_of_split(
    index: SampleIndex, root: str | Path, version: str, split: str
) -> NDArray[np.int64]:
    """Rows of the samples whose scene belongs to a split, in the order of scenes and times.

    Of an official split a part may be there, which is logged: people have parts of nuScenes. A list
    of one's own says what is there.

    Raises:
        DataError: If the split is unknown, none of its scenes is in the data set, or one of those
            that the data set's own `splits.json` lists is not.
    """
    folder = Path(root) / version
    names = scenes_of_split(folder, split)
    wanted = np.isin(index.scene_name, list(names))
    rows = np.flatnonzero(wanted[index.sample_scene])
    if not len(rows):
        raise DataError(
            f"None of the {len(names)} scenes of split '{split}' is in {folder}; "
            "check the version and the split."
        )
    _check_whole(index, folder, split, names)
    order = np.lexsort((index.time_s[rows], index.sample_scene[rows]))
    ordered: NDArray[np.int64] = rows[order]
    return ordered


def _check_whole(index: SampleIndex, folder: Path, split: str, names: tuple[str, ...]) -> None:
    present = set(index.scene_name.tolist())
    missing = [name for name in dict.fromkeys(names) if name not in present]
    if missing and has_own_splits(folder):
        raise DataError(
            f"{len(missing)} of the {len(set(names))} scenes that {folder / 'splits.json'} lists "
            f"for split '{split}' are not in the tables, the first is '{missing[0]}'."
        )
    if missing:
        num = len(set(names))
        logger.warning(
            "Split '%s': %d of %d scenes are in the tables.", split, num - len(missing), num
        )


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
    tables = [folder / f"{name}.json" for name in TABLES.values()]
    missing = [table.name for table in tables if not table.is_file()]
    if missing:
        raise DataError(
            f"The version folder '{folder}' lacks {', '.join(missing)}; "
            "is the data set unpacked and written to its end?"
        )
    return tables


def _build_index(root: Path, version: str, cameras: tuple[str, ...]) -> SampleIndex:
    folder = legible(str(root / version))
    logger.info("Reading the tables of %s (once; the index is cached).", folder)
    tables = join_tables(root / version, cameras)
    frames, scenes, lidar, images = tables.frames, tables.scenes, tables.lidar, tables.images
    # The row -1 of what is not there reads the last frame, which `where` then passes over.
    has_lidar, has_camera = lidar >= 0, images >= 0
    of_lidar, of_image = has_lidar[:, None, None], has_camera[:, :, None, None]
    filename = np.asarray(frames.filename, dtype=object)
    is_sweep = frames.channel[tables.track] == LIDAR
    mounting, intrinsics = tables.ego_from_sensor, tables.rawpixel_from_camera
    time_s, global_from_ego = _ego_frames(tables)
    track_pose = tables.global_from_ego[tables.track]
    problems = find_problems(root / version, tables, time_s, global_from_ego)
    return SampleIndex(
        cameras=np.asarray(cameras),
        sample_token=np.asarray([sample.token for sample in tables.samples]),
        sample_scene=tables.sample_scene,
        time_s=time_s,
        global_from_ego=global_from_ego,
        has_camera=has_camera,
        image_path=np.where(has_camera, filename[images], "").astype(np.str_),
        image_hw=np.where(has_camera[..., None], frames.image_hw[images], 0),
        rawpixel_from_camera=np.where(of_image, intrinsics[frames.calibration[images]], np.eye(3)),
        egocam_from_camera=np.where(of_image, mounting[frames.calibration[images]], np.eye(4)),
        global_from_egocam=np.where(of_image, tables.global_from_ego[images], np.eye(4)),
        camera_time_s=np.where(has_camera, frames.time_us[images] / 1e6, time_s[:, None]),
        lidar_path=np.where(has_lidar, filename[lidar], "").astype(np.str_),
        ego_from_lidar=np.where(of_lidar, mounting[frames.calibration[lidar]], np.eye(4)),
        scene_name=np.asarray([scene.name for scene in scenes]),
        scene_token=np.asarray([scene.token for scene in scenes]),
        scene_description=np.asarray([scene.description[:_SHOWN] for scene in scenes]),
        scene_location=np.asarray(tables.locations),
        scene_log=np.asarray([scene.log_token for scene in scenes]),
        track_start=tables.track_start,
        track_time_s=frames.time_us[tables.track] / 1e6,
        track_xy_m=track_pose[:, :2, 3].copy(),
        track_yaw_rad=yaw_of(track_pose),
        global_from_track=track_pose,
        # Four times as small as texts: there is one for each of some hundred thousand sweeps.
        sweep_path=np.asarray(
            [
                frames.filename[row].encode() if own else b""
                for row, own in zip(tables.track.tolist(), is_sweep.tolist(), strict=True)
            ],
            dtype=np.bytes_,
        ),
        **vars(problems),
    )


def _ego_frames(tables: JoinedTables) -> tuple[FloatArray, FloatArray]:
    """[S] time and [S, 4, 4] `global_from_ego`; 0 and the identity in scenes without a track."""
    lidar, scene = tables.lidar, tables.sample_scene
    # The last one stands for no frame at all.
    frame_time_s = np.append(tables.frames.time_us, 0.0) / 1e6
    poses = np.concatenate([tables.global_from_ego, np.eye(4)[None]])
    time_s, global_from_ego = frame_time_s[lidar], poses[lidar]
    for lacking in np.unique(scene[lidar < 0]):
        track = tables.track[tables.track_start[lacking] : tables.track_start[lacking + 1]]
        own = np.flatnonzero((scene == lacking) & (lidar < 0))
        if not len(track):
            continue
        own_us = np.asarray([tables.samples[row].timestamp for row in own.tolist()])
        first_s, last_s = frame_time_s[track[[0, -1]]]
        time_s[own] = np.clip(np.nan_to_num(own_us) / 1e6, first_s, last_s)
        global_from_ego[own] = interpolate_poses(frame_time_s[track], poses[track], time_s[own])
    return time_s, global_from_ego
