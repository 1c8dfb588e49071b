"""The index of a data set, made from its tables."""

import logging
from pathlib import Path

import numpy as np

from lss_core.data.checks.sample_problems import find_problems
from lss_core.data.samples.index import SampleIndex
from lss_core.data.tables.frames import LIDAR
from lss_core.data.tables.joins import JoinedTables, join_tables
from lss_core.geometry import FloatArray, interpolate_poses, yaw_of
from lss_core.legible import legible

logger = logging.getLogger(__name__)
# Letters of a description that are kept: one long text would make all of them as wide.
_SHOWN = 1000


def build_index(root: Path, version: str, cameras: tuple[str, ...]) -> SampleIndex:
    """Read, join and check the tables of a data set.

    Args:
        root: Folder that holds the version's folder.
        version: Name of the tables' folder.
        cameras: Channels to index, in this order.

    Raises:
        DataError: If a table is unreadable, or a camera is not in it.
    """
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
        cameras=np.asarray(cameras, dtype=np.str_),
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
