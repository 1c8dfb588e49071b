"""Where cameras and lidar are on the car, where they look, and whether their files are there."""

from collections import Counter
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lss_core.camera import field_of_view
from lss_core.data.dataset import raw_hw
from lss_core.data.samples import SampleIndex
from lss_core.errors import DataError
from lss_core.geometry import FloatArray, direction_of
from shoot.data_report.facts import CameraFacts, LidarFacts, Spread
from shoot.data_report.files import look_at_images, look_at_sweeps

# Its numbers were replaced by harmless ones.
_NO_CALIBRATION = "impossible calibration"


def describe_camera(index: SampleIndex, root: Path, camera: int) -> CameraFacts:
    """A camera by its calibrations, image sizes and some of its files.

    Args:
        index: Of the data set.
        root: Its folder.
        camera: Which of its cameras.
    """
    rows = np.flatnonzero(index.has_camera[:, camera])
    reasons = index.problem_reason[index.camera_problem[rows, camera]]
    sound = rows[reasons != _NO_CALIBRATION]
    intrinsics = index.rawpixel_from_camera[sound, camera]
    mounting = index.egocam_from_camera[sound, camera]
    yaw, pitch, roll = _angles(mounting)
    width_px = _widths(index, root, sound, camera)
    known = width_px > 0
    field_rad = field_of_view(intrinsics[known], width_px[known])
    sizes = Counter(_size(*hw) for hw in index.image_hw[rows, camera].tolist())
    return CameraFacts(
        channel=str(index.cameras[camera]),
        num_images=len(rows),
        share=len(rows) / len(index.sample_token),
        sizes=dict(sizes.most_common()),
        height_m=Spread.of(mounting[:, 2, 3]),
        yaw_deg=Spread.of(np.degrees(yaw)),
        pitch_deg=Spread.of(np.degrees(pitch)),
        roll_deg=Spread.of(np.degrees(roll)),
        field_deg=Spread.of(np.degrees(field_rad)),
        principal_x_px=Spread.of(intrinsics[:, 0, 2]),
        principal_y_px=Spread.of(intrinsics[:, 1, 2]),
        files=look_at_images(index, root, rows, camera),
    )


def _angles(mounting: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Yaw, pitch and roll [R] of cameras by `egocam_from_camera` [R, 4, 4]."""
    forward, right_px, down_px = (mounting[:, :3, axis] for axis in (2, 0, 1))
    yaw = direction_of(forward[:, :2])
    pitch = np.arcsin(np.clip(forward[:, 2], -1.0, 1.0))
    # Turned about its axis by the roll, the image's sides have these shares of the vertical.
    roll = np.arctan2(-right_px[:, 2], -down_px[:, 2])
    # Angles near half a circle on both sides of it are one direction: 179 and -179 have no middle.
    if len(yaw) and np.cos(yaw).mean() < 0.0:
        yaw = yaw % (2.0 * np.pi)
        yaw = yaw - 2.0 * np.pi * (yaw.mean() > np.pi + 1e-9)
    return yaw, pitch, roll


def _widths(
    index: SampleIndex, root: Path, rows: NDArray[np.int64], camera: int
) -> NDArray[np.int64]:
    """[R] widths of images; where tables have none, that of the first file, or 0."""
    width_px: NDArray[np.int64] = index.image_hw[rows, camera, 1].copy()
    unknown = np.flatnonzero(width_px == 0)
    if len(unknown):
        try:
            width_px[unknown] = raw_hw(index, root, int(rows[unknown[0]]), camera)[1]
        except DataError:  # said where files are looked at
            return width_px
    return width_px


def _size(height_px: int, width_px: int) -> str:
    return f"{width_px}x{height_px}" if height_px and width_px else "unknown"


def describe_lidar(index: SampleIndex, root: Path) -> LidarFacts:
    """The lidar by its mountings and some of its files.

    Args:
        index: Of the data set.
        root: Its folder.
    """
    rows = np.flatnonzero(index.lidar_path != "")
    sound = rows[index.problem_reason[index.lidar_problem[rows]] != _NO_CALIBRATION]
    return LidarFacts(
        num_keyframes=len(rows),
        num_sweeps=int((index.sweep_path != b"").sum()),
        share=len(rows) / len(index.sample_token),
        height_m=Spread.of(index.ego_from_lidar[sound, 2, 3]),
        files=look_at_sweeps(index, root, rows),
    )
