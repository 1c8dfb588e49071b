"""The rig file: cameras by name, with their images' size, intrinsics and mounting."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import yaml
from numpy.typing import NDArray
from pydantic import ConfigDict, TypeAdapter, ValidationError
from scipy.spatial.transform import Rotation

from lss_core.bounds import Bounds, check_settings
from lss_core.data.checks.calibration import camera_flaws
from lss_core.data.checks.recording import check_transforms, to_array
from lss_core.data.tables.file_names import is_plain
from lss_core.data.tables.problems import intrinsics_flaw
from lss_core.errors import DataError
from lss_core.geometry import FloatArray

_Side = Annotated[int, Bounds(1, 100_000)]
_Degrees = Annotated[float, Bounds(-360.0, 360.0)]
_ANGLES = ("yaw_deg", "pitch_deg", "roll_deg")
# Axes of a camera that looks straight ahead, level: x to the right, y down, z forward.
_EGO_FROM_LEVEL_CAMERA = np.asarray([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])


@dataclass(frozen=True)
class RigCamera:
    """A camera of a rig.

    Attributes:
        name: Its name.
        image_hw: Height and width of its images in pixels.
        rawpixel_from_camera: [3, 3]; pixel (0, 0) has its centre at (0, 0).
        ego_from_camera: [4, 4] (camera: x right, y down, z forward), as it is mounted.
        delay_s: When it fires, after the moment that is planned from; negative: before.
    """

    name: str
    image_hw: tuple[int, int]
    rawpixel_from_camera: FloatArray
    ego_from_camera: FloatArray
    delay_s: float = 0.0


@dataclass(frozen=True)
class Rig:
    """All cameras of a rig.

    Attributes:
        cameras: In the file's order.
        oddities: Sentences on what is strange about them, if not for sure wrong.
    """

    cameras: tuple[RigCamera, ...]
    oddities: tuple[str, ...] = ()


@dataclass(frozen=True)
class _Entry:
    """A camera as the file has it; numbers that may have several forms are looked at later."""

    __pydantic_config__ = ConfigDict(extra="forbid")

    name: str
    width_px: _Side
    height_px: _Side
    intrinsics: object
    distortion: object = None
    ego_from_camera: object = None
    position_m: object = None
    yaw_deg: _Degrees | None = None
    pitch_deg: _Degrees | None = None
    roll_deg: _Degrees | None = None
    delay_s: Annotated[float, Bounds(-1.0, 1.0)] = 0.0

    def __post_init__(self) -> None:
        check_settings(self)


@dataclass(frozen=True)
class _RigFile:
    __pydantic_config__ = ConfigDict(extra="forbid")

    cameras: list[_Entry]


def read_rig(path: Path) -> Rig:
    """The cameras of a rig file, checked as those of a data set are.

    Raises:
        DataError: If the file is missing or no such file, or a camera cannot be as it says.
    """
    entries = _entries(path)
    names = [entry.name for entry in entries]
    for name in names:
        if not is_plain(name) or "=" in name:
            raise DataError(
                f"'{path}' has a camera named '{name}', which can be no name of a folder, or has "
                "an equals sign; name it otherwise."
            )
        if names.count(name) > 1:
            raise DataError(f"'{path}' has two cameras named '{name}'; name each once.")
    read = [_camera(entry, f"Camera '{entry.name}' of '{path}'") for entry in entries]
    flaws = camera_flaws(
        np.stack([camera.rawpixel_from_camera for camera in read]),
        np.stack([camera.ego_from_camera for camera in read]),
        np.asarray([camera.image_hw for camera in read]),
        [entry.distortion for entry in entries],
    )
    told = [(flaw.is_sure, f"Camera '{names[flaw.camera]}' has {flaw.text}.") for flaw in flaws]
    for is_sure, sentence in told:
        if is_sure:
            raise DataError(f"'{path}': {sentence}")
    return Rig(tuple(read), tuple(sentence for _, sentence in told))


def look_from(
    position_m: NDArray[np.floating[Any]], yaw_rad: float, pitch_rad: float, roll_rad: float
) -> FloatArray:
    """`ego_from_camera` [4, 4] of a camera by where it is and where it looks.

    Args:
        position_m: (x, y, z) in `ego`.
        yaw_rad: Of the viewing direction: 0 ahead, positive to the left.
        pitch_rad: Of the viewing direction: 0 level, positive up.
        roll_rad: About the viewing direction: 0 upright, positive if its right side goes down.
    """
    ego_from_camera = np.eye(4)
    # About the ego's axes z, y, x: pitching about y, which points left, looks down.
    turn = Rotation.from_euler("ZYX", [yaw_rad, -pitch_rad, roll_rad]).as_matrix()
    ego_from_camera[:3, :3] = turn @ _EGO_FROM_LEVEL_CAMERA
    ego_from_camera[:3, 3] = position_m
    return ego_from_camera


def _entries(path: Path) -> list[_Entry]:
    try:
        loaded = yaml.safe_load(path.read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise DataError(
            f"There is no rig file '{path}'; shoot-plan --example DIR writes one to start from."
        ) from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise DataError(f"'{path}' is no YAML: {error}") from error
    try:
        entries = TypeAdapter(_RigFile).validate_python(loaded).cameras
    except ValidationError as error:
        (first, *_) = error.errors()
        place = ".".join(_place(part, loaded) for part in first["loc"])
        message = first["msg"].removeprefix("Value error, ").rstrip(".")
        raise DataError(
            f"'{path}' is no rig file: {f'{place}: ' if place else ''}{message}."
        ) from error
    if not entries:
        raise DataError(f"'{path}' has no camera; a rig has one or more.")
    return entries


def _place(part: int | str, loaded: Any) -> str:
    """Words for a step into the file: of a camera its name, if it has one."""
    if not isinstance(part, int):
        return part
    entry = loaded["cameras"][part]
    name = entry.get("name") if isinstance(entry, dict) else None
    return f"'{name}'" if isinstance(name, str) else f"number {part + 1}"


def _camera(entry: _Entry, what: str) -> RigCamera:
    intrinsics = _intrinsics(entry.intrinsics, what)
    flaw = intrinsics_flaw(intrinsics.tolist())
    if flaw:
        raise DataError(f"{what} has {flaw}.")
    ego_from_camera = _mounting(entry, what)
    check_transforms(ego_from_camera[None], f"{what}: ego_from_camera", is_mounting=True)
    image_hw = (entry.height_px, entry.width_px)
    return RigCamera(entry.name, image_hw, intrinsics, ego_from_camera, entry.delay_s)


def _intrinsics(given: Any, what: str) -> FloatArray:
    """[3, 3] from a matrix, or from fx, fy, cx and cy."""
    if not isinstance(given, dict):
        return to_array(given, (3, 3), f"{what}: intrinsics")
    if set(given) != {"fx", "fy", "cx", "cy"}:
        raise DataError(
            f"{what} has intrinsics of {', '.join(map(str, given)) or 'nothing'}; give fx, fy, cx "
            "and cy in pixels, or a 3 x 3 matrix."
        )
    numbers = [given[name] for name in ("fx", "fy", "cx", "cy")]
    fx, fy, cx, cy = to_array(numbers, (4,), f"{what}: fx, fy, cx and cy")
    return np.asarray([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])


def _mounting(entry: _Entry, what: str) -> FloatArray:
    """[4, 4] from a matrix, or from position and angles."""
    angles = [getattr(entry, name) for name in _ANGLES]
    has_angles = any(angle is not None for angle in angles)
    if entry.ego_from_camera is not None:
        if entry.position_m is not None or has_angles:
            raise DataError(
                f"{what} has ego_from_camera and also position_m or angles; keep one of the two."
            )
        matrix: Any = entry.ego_from_camera
        return to_array(matrix, (4, 4), f"{what}: ego_from_camera")
    if entry.position_m is None or entry.yaw_deg is None:
        raise DataError(
            f"{what} does not say how it is mounted; give ego_from_camera, or position_m and "
            "yaw_deg (with pitch_deg and roll_deg where they are not 0)."
        )
    position: Any = entry.position_m
    yaw, pitch, roll = (np.deg2rad(angle or 0.0) for angle in angles)
    return look_from(to_array(position, (3,), f"{what}: position_m"), yaw, pitch, roll)
