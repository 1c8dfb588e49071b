"""What a recording cannot be: refused before tables are made of it.

The same numbers in tables that others wrote are problems of their records (`tables/problems.py`).
Here the caller is at hand, and what he gives has names he knows.
"""

import math
from collections.abc import Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from lss_core.data.checks.calibration import camera_flaws
from lss_core.data.tables.problems import intrinsics_flaw, is_time, step_flaws, transform_flaws
from lss_core.errors import DataError
from lss_core.geometry import FloatArray, quaternion_of

# What callers may give for an array: one of any type, or nested lists.
Numbers: TypeAlias = NDArray[Any] | Sequence[Any]

# Of a rotation's columns: matrices in text files have six digits.
_RIGID_TOLERANCE = 1e-3


def to_array(values: Numbers, shape: Sequence[int | None], what: str) -> FloatArray:
    """Numbers as an array of a shape, in which None stands for any length.

    Raises:
        DataError: If they are none, not finite or of another shape.
    """
    wanted = "[" + ", ".join("any" if side is None else str(side) for side in shape) + "]"
    try:
        array = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise DataError(f"{what} must be numbers of shape {wanted}: {error}.") from error
    fits = len(array.shape) == len(shape) and all(
        side in (None, own) for side, own in zip(shape, array.shape, strict=True)
    )
    if not fits:
        raise DataError(f"{what} must have the shape {wanted}, got {list(array.shape)}.")
    if not np.isfinite(array).all():
        raise DataError(f"{what} must be finite, but some of its numbers are not.")
    return array


def to_us(time_s: Numbers, what: str) -> NDArray[np.int64]:
    """[T] seconds, of any origin, as whole microseconds.

    Raises:
        DataError: If they cannot be seconds.
    """
    seconds = to_array(time_s, (None,), what)
    good = is_time(seconds * 1e6)
    if not good.all():
        raise DataError(f"{what} must be in seconds, got {seconds[~good][0]:g}.")
    times_us: NDArray[np.int64] = np.round(seconds * 1e6).astype(np.int64)
    return times_us


def check_transforms(a_from_b: FloatArray, what: str, is_mounting: bool) -> None:
    """Refuse what turns and moves nothing by its rotation and translation alone.

    Args:
        a_from_b: [R, 4, 4].
        what: Words for them.
        is_mounting: Of sensors on a car, rather than of things in the world.

    Raises:
        DataError: If one of them is not rigid, or its translation cannot be.
    """
    rotation = a_from_b[:, :3, :3]
    off = np.abs(rotation @ rotation.swapaxes(-1, -2) - np.eye(3)).max(axis=(-1, -2))
    good = (off < _RIGID_TOLERANCE) & (a_from_b[:, 3] == [0.0, 0.0, 0.0, 1.0]).all(axis=-1)
    good &= np.linalg.det(rotation) > 0.0
    if not good.all():
        number = int(good.argmin())
        is_mirrored = off[number] < _RIGID_TOLERANCE and np.linalg.det(rotation[number]) < 0.0
        flaw = "it mirrors" if is_mirrored else f"its rows are {a_from_b[number].tolist()}"
        which = f" number {number}" if len(a_from_b) > 1 else ""
        raise DataError(f"{what}{which} is no rigid 4 x 4 transform: {flaw}.")
    flaws = transform_flaws(a_from_b[:, :3, 3], quaternion_of(a_from_b), is_mounting)
    flaw = next((flaw for flaw in flaws if flaw), "")
    if flaw:
        raise DataError(f"{what} has {flaw}.")


def check_poses(times_us: NDArray[np.int64], global_from_ego: FloatArray, what: str) -> None:
    """Refuse poses [P, 4, 4] at times [P] that no car has.

    Raises:
        DataError: If times do not increase, a pose is not rigid, or the car leaps.
    """
    if len(times_us) < 2:
        raise DataError(f"{what} must be two or more, got {len(times_us)}.")
    elapsed_s = np.diff(times_us) / 1e6
    if (elapsed_s <= 0.0).any():
        row = int((elapsed_s <= 0.0).argmax())
        raise DataError(
            f"{what} must have times that increase, but {times_us[row + 1] / 1e6:.6f} s follows "
            f"{times_us[row] / 1e6:.6f} s."
        )
    check_transforms(global_from_ego, what, is_mounting=False)
    moved_m = np.linalg.norm(np.diff(global_from_ego[:, :3, 3], axis=0), axis=-1)
    steps = step_flaws(elapsed_s, moved_m, lambda row: f"{what} number {row} and {row + 1}")
    for problem in steps.values():
        raise DataError(f"{problem.what}; are times in seconds and places in metres?")


def check_camera(
    rawpixel_from_camera: FloatArray,
    ego_from_camera: FloatArray,
    image_hw: tuple[int, int],
    what: str,
) -> None:
    """Refuse intrinsics [3, 3] and a mounting [4, 4] that an index of the tables would refuse.

    Raises:
        DataError: If they are no pinhole's, or fit neither image nor car.
    """
    flaw = intrinsics_flaw(rawpixel_from_camera.tolist())
    if flaw:
        raise DataError(f"{what} has {flaw}.")
    for one in camera_flaws(
        rawpixel_from_camera[None], ego_from_camera[None], np.asarray([image_hw]), [None]
    ):
        if one.is_sure:
            raise DataError(f"{what} has {one.text}.")


def check_size(image_hw: Sequence[int], what: str) -> tuple[int, int]:
    """Height and width.

    Raises:
        DataError: If they cannot be.
    """
    sides = to_array(image_hw, (2,), f"{what}: image_hw")
    if any(side < 1 or not math.isclose(side, round(side)) for side in sides.tolist()):
        raise DataError(f"{what} has images of {sides.tolist()} px, which cannot be.")
    return round(sides[0]), round(sides[1])
