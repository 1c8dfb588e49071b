"""Argoverse 2 sensor logs: seven cameras around the car, two lidars, boxes.

SRC/{train,val,test}/<log>/, or SRC/<log>/
    city_SE3_egovehicle.feather
    calibration/egovehicle_SE3_sensor.feather, intrinsics.feather
    sensors/cameras/<camera>/<nanoseconds>.jpg
    sensors/lidar/<nanoseconds>.feather
    annotations.feather
"""

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lss_core.data.converters.drive import CameraTrack, Drive, FoundDrive, SeenBox, SweepTrack
from lss_core.errors import DataError
from lss_core.geometry import FloatArray, apply, invert, rigid_from_quaternion

# Argoverse's ego frame is ours, but for its origin: the middle of the rear axle itself, about
# 0.33 m above the road, by the comments of the data set's own tools.
EGO_FROM_EGOVEHICLE = np.array(
    [[1.0, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0.33], [0, 0, 0, 1]], dtype=np.float64
)
CAMERAS = (
    "ring_front_center",
    "ring_front_left",
    "ring_front_right",
    "ring_side_left",
    "ring_side_right",
    "ring_rear_left",
    "ring_rear_right",
)
SPLITS = ("train", "val", "test")
_POSES = "city_SE3_egovehicle.feather"
_QUATERNION, _PLACE = ("qw", "qx", "qy", "qz"), ("tx_m", "ty_m", "tz_m")
_SIZE = ("length_m", "width_m", "height_m")
# There is a pose for every file of every sensor; so many are more than a path needs.
_POSE_EVERY_S = 0.04
# The upper of the two lidars; sweeps hold the points of both.
_LIDAR = "up_lidar"


def find_argoverse2(src: Path, lidar: bool = False) -> list[FoundDrive]:
    """The logs below a folder; those in folders train, val and test are of these splits.

    Args:
        src: Folder with logs, or with splits.
        lidar: Read the sweeps, too.

    Raises:
        DataError: If there is none, or the library that reads them is not installed.
    """
    folders = {
        path.parent: split
        for split in ("", *SPLITS)
        for path in sorted((src / split).glob(f"*/{_POSES}"))
    }
    if not folders:
        raise DataError(
            f"'{src}' has no log of Argoverse 2: expected folders of logs, or train, val and test "
            f"with such folders, each with a file {_POSES}."
        )
    _feather()
    return [
        FoundDrive(folder.name, partial(_read, folder, lidar), split=split)
        for folder, split in folders.items()
    ]


def _read(folder: Path, lidar: bool) -> Drive:
    poses = _table(folder / _POSES, ("timestamp_ns", *_QUATERNION, *_PLACE))
    order = np.argsort(poses["timestamp_ns"], kind="stable")
    kept = order[_spread(_seconds(poses["timestamp_ns"][order]))]
    global_from_ego = (_transforms(poses) @ invert(EGO_FROM_EGOVEHICLE))[kept]
    mountings = _table(
        folder / "calibration" / "egovehicle_SE3_sensor.feather",
        ("sensor_name", *_QUATERNION, *_PLACE),
    )
    egovehicle_from_sensor = dict(
        zip(mountings["sensor_name"].tolist(), _transforms(mountings), strict=True)
    )
    cameras = _cameras(folder, egovehicle_from_sensor)
    boxes = _boxes(folder / "annotations.feather")
    sweeps = _sweeps(folder, egovehicle_from_sensor[_LIDAR]) if lidar else None
    if sweeps is not None:
        moments_s = sweeps.time_s
    elif boxes:
        moments_s = np.unique([box.time_s for box in boxes])
    else:
        moments_s = next(iter(cameras.values())).time_s
    time_s = _seconds(poses["timestamp_ns"][kept])
    return Drive(time_s, global_from_ego, cameras, moments_s, sweeps, boxes)


def _cameras(folder: Path, egovehicle_from_sensor: dict[str, FloatArray]) -> dict[str, CameraTrack]:
    """Those with images. Images are undistorted: the coefficients k1 to k3 are the raw lens'."""
    table = _table(
        folder / "calibration" / "intrinsics.feather",
        ("sensor_name", "fx_px", "fy_px", "cx_px", "cy_px", "height_px", "width_px"),
    )
    names = table["sensor_name"].tolist()
    cameras = {}
    for name in CAMERAS:
        files = _stamped(folder / "sensors" / "cameras" / name, "*.jpg")
        if not files:
            continue
        row = {column: values[names.index(name)] for column, values in table.items()}
        matrix = np.array([
            [row["fx_px"], 0.0, row["cx_px"]],
            [0.0, row["fy_px"], row["cy_px"]],
            [0.0, 0.0, 1.0],
        ])  # fmt: skip
        cameras[name] = CameraTrack(
            matrix,
            EGO_FROM_EGOVEHICLE @ egovehicle_from_sensor[name],
            (int(row["height_px"]), int(row["width_px"])),
            _seconds(np.array(list(files))),
            list(files.values()),
        )
    if not cameras:
        raise DataError(f"'{folder / 'sensors' / 'cameras'}' has no image of a ring camera.")
    return cameras


def _sweeps(folder: Path, egovehicle_from_lidar: FloatArray) -> SweepTrack:
    """Sweeps are points in the ego frame, at the time of the sweep's name."""
    files = _stamped(folder / "sensors" / "lidar", "*.feather")
    if not files:
        raise DataError(f"'{folder / 'sensors' / 'lidar'}' has no sweeps; leave out --lidar.")
    paths = list(files.values())
    lidar_from_egovehicle = invert(egovehicle_from_lidar)

    def load(number: int) -> NDArray[Any]:
        table = _table(paths[number], ("x", "y", "z", "intensity", "laser_number"))
        points = apply(lidar_from_egovehicle, _columns(table, ("x", "y", "z")))
        return np.hstack([points, _columns(table, ("intensity", "laser_number"))])

    mounting = EGO_FROM_EGOVEHICLE @ egovehicle_from_lidar
    return SweepTrack(mounting, _seconds(np.array(list(files))), load)


def _boxes(path: Path) -> list[SeenBox]:
    """Of a log's annotations, which those of the test split have not."""
    if not path.exists():
        return []
    names = ("timestamp_ns", "track_uuid", "category", *_SIZE, *_QUATERNION, *_PLACE)
    table = _table(path, names)
    return [
        SeenBox(time_s, str(instance), str(category), size_m, pose)
        for time_s, instance, category, size_m, pose in zip(
            _seconds(table["timestamp_ns"]).tolist(),
            table["track_uuid"],
            table["category"],
            _columns(table, _SIZE),
            EGO_FROM_EGOVEHICLE @ _transforms(table),
            strict=True,
        )
    ]


def _spread(time_s: FloatArray) -> NDArray[np.int64]:
    """Rows of increasing times that lie 0.04 s apart or more, the last one with them."""
    rows = [0]
    for row in range(1, len(time_s)):
        if time_s[row] - time_s[rows[-1]] >= _POSE_EVERY_S:
            rows.append(row)
    if len(rows) > 1 and rows[-1] != len(time_s) - 1:
        rows[-1] = len(time_s) - 1
    return np.array(rows)


def _transforms(table: dict[str, NDArray[Any]]) -> FloatArray:
    return rigid_from_quaternion(_columns(table, _PLACE), _columns(table, _QUATERNION))


def _columns(table: dict[str, NDArray[Any]], names: tuple[str, ...]) -> FloatArray:
    columns: FloatArray = np.stack([table[name].astype(np.float64) for name in names], axis=-1)
    return columns


def _seconds(time_ns: NDArray[Any]) -> FloatArray:
    """Whole microseconds, as tables have them, so that equal times stay equal."""
    time_us: FloatArray = np.round(time_ns.astype(np.int64) / 1e3)
    return time_us / 1e6


def _stamped(folder: Path, pattern: str) -> dict[int, Path]:
    """Files by the nanoseconds that they are called after, in order."""
    files = {int(path.stem): path for path in folder.glob(pattern)}
    return dict(sorted(files.items()))


def _table(path: Path, names: tuple[str, ...]) -> dict[str, NDArray[Any]]:
    """Columns of a feather file."""
    with path.open("rb") as stream:
        table = _feather().read_table(stream, columns=list(names))
    return {name: table[name].to_numpy() for name in names}


def _feather() -> Any:
    try:
        from pyarrow import feather
    except ImportError as error:
        raise DataError(
            f"Logs of Argoverse 2 need pyarrow: pip install 'shoot-planner[argoverse]' ({error})."
        ) from error
    return feather
