"""Calibrations of cameras held against their images and the car."""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lss_core.data.tables.transforms import reordered
from lss_core.geometry import FloatArray, invert

# Where a principal point is for sure wrong, and where it is for sure right: shares of the sides.
_WRONG_SHARES = (0.1, 0.9)
_RIGHT_SHARES = (0.25, 0.75)
# Both shares the same and this far out: the image was scaled, its intrinsics were not.
_SCALED_SHARES = (0.3, 0.72)
_FIELDS_OF_VIEW_DEG = (5.0, 170.0)
# The cosine between a camera's y axis and straight down, of any and of a usual camera.
_LEAST_DOWN, _USUAL_DOWN = 0.3, 0.7
_USUAL_HEIGHTS_M = (0.2, 5.0)
_UNDER_ROAD_M = -0.5
# Origins of the ego frame may be high up: lower or higher than this is strange all the same.
_STRANGE_HEIGHTS_M = (-2.0, 6.0)
_DISTORTION_PX = 2.0
_DISTORTION = 1e-3
_OPENCV_LENGTHS = (4, 5)
# Large enough for any model, and its powers are finite.
_HUGE = 1e30
_SHOWN = 8


@dataclass(frozen=True)
class CameraFlaw:
    """What is wrong, or strange, with a camera.

    Attributes:
        reason: Its kind.
        camera: Row of the camera.
        text: What was seen, and the likely mistake if one is known.
        is_sure: Whether it cannot be meant.
    """

    reason: str
    camera: int
    text: str
    is_sure: bool = True


def camera_flaws(
    rawpixel_from_camera: FloatArray,
    ego_from_camera: FloatArray,
    image_hw: NDArray[np.int64],
    distortion: list[Any],
) -> list[CameraFlaw]:
    """What is wrong with Q cameras.

    Args:
        rawpixel_from_camera: [Q, 3, 3].
        ego_from_camera: [Q, 4, 4].
        image_hw: [Q, 2] of their images; 0 where it is not known.
        distortion: Q values of `camera_distortion`, whatever they are.
    """
    return [
        *_image_flaws(rawpixel_from_camera, image_hw),
        *_distortion_flaws(rawpixel_from_camera, image_hw, distortion),
        *_mounting_flaws(ego_from_camera),
    ]


def _image_flaws(
    rawpixel_from_camera: FloatArray, image_hw: NDArray[np.int64]
) -> Iterable[CameraFlaw]:
    """Principal points and focal lengths that belong to other images."""
    size_px = image_hw[:, ::-1].astype(np.float64)
    is_known = (size_px > 0).all(axis=-1)
    size_px = np.where(is_known[:, None], size_px, 1.0)
    centre_px = rawpixel_from_camera[:, :2, 2]
    focal_px = rawpixel_from_camera[:, [0, 1], [0, 1]]
    share = centre_px / size_px
    is_out = ((share < _WRONG_SHARES[0]) | (share > _WRONG_SHARES[1])).any(axis=-1)
    mean = share.mean(axis=-1)
    is_even = np.abs(share[:, 0] - share[:, 1]) < 0.15 * np.abs(mean)
    is_scaled = is_even & ((mean < _SCALED_SHARES[0]) | (mean > _SCALED_SHARES[1]))
    swapped = centre_px / size_px[:, ::-1]
    is_swapped = (np.abs(swapped - 0.5) < 0.1).all(axis=-1) & (np.abs(share - 0.5) > 0.1).all(
        axis=-1
    )
    is_aside = ((share < _RIGHT_SHARES[0]) | (share > _RIGHT_SHARES[1])).any(axis=-1)
    sure = is_out | is_scaled | is_swapped
    for row in np.flatnonzero(is_known & (sure | is_aside)).tolist():
        text = (
            f"principal point ({centre_px[row, 0]:.4g}, {centre_px[row, 1]:.4g}) px in images of "
            f"{size_px[row, 0]:.0f} x {size_px[row, 1]:.0f} px"
        )
        if is_swapped[row]:
            text += "; width and height look swapped, or x and y of the principal point"
        elif (np.abs(centre_px[row]) <= 1.0).all():
            text += "; camera_intrinsic looks like shares of the image, not pixels"
        elif is_scaled[row]:
            text += f"; these look like intrinsics of images {2.0 * mean[row]:.2g} times as large"
        yield CameraFlaw("calibration against image", row, text, is_sure=bool(sure[row]))
    view_deg = np.rad2deg(2.0 * np.arctan(0.5 * size_px / focal_px))
    narrowest, widest = _FIELDS_OF_VIEW_DEG
    strange = ((view_deg < narrowest) | (view_deg > widest)).any(axis=-1)
    for row in np.flatnonzero(is_known & strange).tolist():
        text = (
            f"focal lengths {focal_px[row, 0]:.4g} and {focal_px[row, 1]:.4g} px, a field of view "
            f"of {view_deg[row, 0]:.3g} x {view_deg[row, 1]:.3g} degrees"
        )
        if (focal_px[row] < 50.0).all() and view_deg[row].max() > widest:
            text += "; they look like millimetres, not pixels"
        yield CameraFlaw("calibration against image", row, text)


def _distortion_flaws(
    rawpixel_from_camera: FloatArray, image_hw: NDArray[np.int64], distortion: list[Any]
) -> Iterable[CameraFlaw]:
    """Lens distortion that would be ignored: cameras are pinholes here."""
    for row, given in enumerate(distortion):
        numbers = _numbers(given) if given else []
        if not np.any(numbers):
            continue
        is_model = len(numbers) in _OPENCV_LENGTHS
        shift_px = (
            _largest_shift_px(rawpixel_from_camera[row], image_hw[row], numbers)
            if is_model
            else math.inf
        )
        # Comparisons with what is no number are false.
        if shift_px <= _DISTORTION_PX or (not is_model and np.abs(numbers).max() <= _DISTORTION):
            continue
        text = f"camera_distortion {numbers[:_SHOWN]}"
        text += f", which shifts a corner by {shift_px:.0f} px" if is_model else ""
        text += ", while cameras are pinholes here; undistort the images first"
        yield CameraFlaw("distorted images", row, text)


def _numbers(given: Any) -> list[float]:
    """All numbers of a value of JSON, however it nests them."""
    numbers, open_ones = [], [given]
    while open_ones:
        value = open_ones.pop()
        if isinstance(value, dict):
            value = list(value.values())
        if isinstance(value, list):
            open_ones += value[::-1]
        elif isinstance(value, int | float):
            numbers.append(float(max(min(value, _HUGE), -_HUGE)))
    return numbers


def _largest_shift_px(
    rawpixel_from_camera: FloatArray, image_hw: NDArray[np.int64], numbers: list[float]
) -> float:
    """How far OpenCV's k1, k2, p1, p2 (, k3) shift the image's corners, at most."""
    (fx, fy), (cx, cy) = rawpixel_from_camera[[0, 1], [0, 1]], rawpixel_from_camera[:2, 2]
    height, width = np.where(image_hw > 0, image_hw, [2.0 * cy, 2.0 * cx])
    x = (np.asarray([0.0, width, 0.0, width]) - cx) / fx
    y = (np.asarray([0.0, 0.0, height, height]) - cy) / fy
    k1, k2, p1, p2, k3 = [*numbers, 0.0][:5]
    square = x**2 + y**2
    radial = k1 * square + k2 * square**2 + k3 * square**3
    x_shift = x * radial + 2.0 * p1 * x * y + p2 * (square + 2.0 * x**2)
    y_shift = y * radial + p1 * (square + 2.0 * y**2) + 2.0 * p2 * x * y
    return float(np.hypot(fx * x_shift, fy * y_shift).max())


def _mounting_flaws(ego_from_camera: FloatArray) -> Iterable[CameraFlaw]:
    """Cameras whose images are not upright, or that are under the road."""
    down, height_m = -ego_from_camera[:, 2, 1], ego_from_camera[:, 2, 3]
    inverted = _is_usual(invert(ego_from_camera)) & (height_m < _USUAL_HEIGHTS_M[0])
    inverted &= (down < _USUAL_DOWN) | (height_m < _UNDER_ROAD_M)
    flawed = np.flatnonzero(inverted | (down < _LEAST_DOWN))
    explained = {
        text: set(flawed[_is_usual(mended)].tolist())
        for text, mended in _mended(ego_from_camera[flawed])
    }
    for row in flawed.tolist():
        off_deg = np.rad2deg(np.arccos(np.clip(down[row], -1.0, 1.0)))
        side = "below" if height_m[row] < 0.0 else "above"
        text = (
            f"its camera {abs(height_m[row]):.2g} m {side} the road and the y axis of images "
            f"{off_deg:.0f} degrees off straight down"
        )
        mistakes = [mistake for mistake, rows in explained.items() if row in rows]
        if mistakes:
            # What explains most is the likeliest; of equals the first.
            text += f"; {max(mistakes, key=lambda mistake: len(explained[mistake]))}"
        yield CameraFlaw("calibration against car", row, text)
    lowest_m, highest_m = _STRANGE_HEIGHTS_M
    strange = (height_m < lowest_m) | (height_m > highest_m)
    strange[flawed] = False
    for row in np.flatnonzero(strange).tolist():
        text = f"its camera at a height of {height_m[row]:.3g} m over the ego's origin"
        yield CameraFlaw("calibration against car", row, text, is_sure=False)


def _is_usual(ego_from_camera: FloatArray) -> NDArray[np.bool_]:
    """[Q] whether cameras are upright, look ahead rather than up or down, and above the road."""
    lowest_m, highest_m = _USUAL_HEIGHTS_M
    height_m = ego_from_camera[:, 2, 3]
    usual: NDArray[np.bool_] = (
        (-ego_from_camera[:, 2, 1] > _USUAL_DOWN)
        & (np.abs(ego_from_camera[:, 2, 2]) < _USUAL_DOWN)
        & (height_m > lowest_m)
        & (height_m < highest_m)
    )
    return usual


def _mended(ego_from_camera: FloatArray) -> Iterable[tuple[str, FloatArray]]:
    """Mountings as they were if some mistake had not been made."""
    yield "the mounting looks inverted (camera_from_ego)", invert(ego_from_camera)
    yield "the ego's axes look like x forward, y right, z down", _Y_RIGHT_Z_DOWN @ ego_from_camera
    for text, change in _ROTATIONS.items():
        mended = ego_from_camera.copy()
        mended[:, :3, :3] = change(ego_from_camera[:, :3, :3])
        yield text, mended


_Y_RIGHT_Z_DOWN = np.diag([1.0, -1.0, -1.0, 1.0])
# The right, down and forward axes of a camera that was given as x forward, y left, z up.
_X_FORWARD_Z_UP = np.asarray([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
_UPSIDE_DOWN = np.diag([-1.0, -1.0, 1.0])

_ROTATIONS: dict[str, Callable[[FloatArray], FloatArray]] = {
    "the rotation looks like x, y, z, w instead of w, x, y, z": reordered,
    "the rotation looks inverted": lambda turn: np.swapaxes(turn, -1, -2),
    "the camera's axes look like x forward, y left, z up": lambda turn: turn @ _X_FORWARD_Z_UP,
    "the camera looks upside down": lambda turn: turn @ _UPSIDE_DOWN,
}
