"""A few images of each camera with what calibration, poses and crop make of them."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lss_core.camera import horizon_row
from lss_core.config import ImageConfig
from lss_core.data.dataset import ego_from_camera, raw_hw
from lss_core.data.samples import TIME_TOLERANCE_S, SampleIndex
from lss_core.data.sensors.images import PixelMap, draw_pixel_map, load_image
from lss_core.errors import DataError
from lss_core.geometry import FloatArray
from lss_core.legible import legible
from shoot.data_report.files import is_file
from shoot.rendering import CalibrationView
from shoot.trajectories import HORIZON_S, futures_from_poses

_SHOWN = 4
_SHOWN_WIDTH_PX = 800
_FAR_ENOUGH_M = 5.0


def view_cameras(
    index: SampleIndex, root: Path, config: ImageConfig
) -> dict[str, tuple[CalibrationView, ...]]:
    """Views by camera, of those that have images on disk.

    Args:
        index: Of the data set.
        root: Its folder.
        config: What the network is to be given of an image.
    """
    way_m = _ways(index)
    views = {}
    for camera, name in enumerate(index.cameras.tolist()):
        rows = _telling(np.flatnonzero(index.has_camera[:, camera]), way_m)
        found = (_view(index, root, row, camera, config) for row in rows)
        own = tuple(view for view in found if view is not None)
        if own:
            views[name] = own
    return views


def _ways(index: SampleIndex) -> FloatArray:
    """[S] distance to where the car is 5 s later; -1 where that is not recorded."""
    way_m = np.full(len(index.sample_token), -1.0)
    for scene in range(len(index.scene_name)):
        track = index.track(scene)
        time_s, rows = index.track_time_s[track], np.flatnonzero(index.sample_scene == scene)
        if not len(time_s) or not len(rows):
            continue
        rows = rows[index.time_s[rows] + HORIZON_S <= time_s[-1] + TIME_TOLERANCE_S]
        here_m, there_m = (
            np.stack([np.interp(at_s, time_s, x) for x in index.track_xy_m[track].T], axis=-1)
            for at_s in (index.time_s[rows], index.time_s[rows] + HORIZON_S)
        )
        way_m[rows] = np.linalg.norm(there_m - here_m, axis=-1)
    return way_m


def _telling(rows: NDArray[np.int64], way_m: FloatArray) -> list[int]:
    """A few samples, spread over those that drive, else over those with a future, else over all."""
    for least_m in (_FAR_ENOUGH_M, 0.0):
        far = rows[way_m[rows] >= least_m]
        if len(far):
            rows = far
            break
    places = np.linspace(0, len(rows) - 1, min(_SHOWN, len(rows))).round().astype(int)
    return [int(row) for row in rows[places]]


def _view(
    index: SampleIndex, root: Path, row: int, camera: int, config: ImageConfig
) -> CalibrationView | None:
    """Of one image; None if it is not there or damaged, which the report says."""
    path = root / str(index.image_path[row, camera])
    if not is_file(path):
        return None
    try:
        sides_px = raw_hw(index, root, row, camera)
        scale = min(1.0, _SHOWN_WIDTH_PX / sides_px[1])
        shown_hw = max(1, round(sides_px[0] * scale)), max(1, round(sides_px[1] * scale))
        shown = PixelMap(shown_hw, 0, 0, False, 0.0, shown_hw, sides_px)
        image = load_image(path, shown)
    except DataError:
        return None
    pixel_from_rawpixel = shown.pixel_from_rawpixel
    intrinsics = index.rawpixel_from_camera[row, camera]
    horizon = horizon_row(intrinsics, index.egocam_from_camera[row, camera])
    given = draw_pixel_map(config, sides_px, None, horizon)
    pixel_from_given = pixel_from_rawpixel @ np.linalg.inv(given.pixel_from_rawpixel)
    scene = str(index.scene_name[index.sample_scene[row]])
    return CalibrationView(
        image=image,
        pixel_from_camera=pixel_from_rawpixel @ intrinsics,
        ego_from_camera=ego_from_camera(index, row)[camera],
        driven=_driven(index, row),
        kept=_corners(pixel_from_given, given.image_hw),
        label=legible(f"{scene}, sample {index.sample_token[row]}"),
    )


def _corners(pixel_from_given: FloatArray, image_hw: tuple[int, int]) -> FloatArray:
    """[4, 2] outer corners of an image, in another's pixels."""
    low, (height, width) = -0.5, (side - 0.5 for side in image_hw)
    corners = np.array([[low, low], [width, low], [width, height], [low, height]])
    moved: FloatArray = corners @ pixel_from_given[:2, :2].T + pixel_from_given[:2, 2]
    return moved


def _driven(index: SampleIndex, row: int) -> FloatArray | None:
    """[T, 2] the next 5 s, if they are recorded; also where a scene's poses have a problem."""
    track = index.track(int(index.sample_scene[row]))
    time_s = index.track_time_s[track]
    if not len(time_s):
        return None
    start_s = np.array([index.time_s[row] - time_s[0]])
    poses = time_s - time_s[0], index.track_xy_m[track], index.track_yaw_rad[track]
    paths, _ = futures_from_poses(*poses, start_s)
    return paths[0] if len(paths) else None
