"""A folder laid out as Argoverse 2's sensor logs, of drives that are known."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pyarrow as pa
from filmed_drive import FilmedDrive
from PIL import Image
from pyarrow import feather

from lss_core.geometry import FloatArray, invert, quaternion_of

BEGIN_NS = 315_967_376_859_506_000
AXLE_HEIGHT_M = 0.33
# Seconds from a log's begin to the first file of a sensor.
LATE_S = {"lidar": 0.05, "ring_front_center": 0.031, "ring_front_left": 0.044, "ring_rear_right": 0}
CAMERA_S, SWEEP_S = 0.05, 0.1
IMAGE_HW = {"ring_front_center": (256, 194)}  # the one that stands upright, an eighth of its size
OTHER_HW = (194, 256)
# Angles to the left, down and clockwise, places in Argoverse's ego frame.
LOOKS: dict[str, tuple[float, float, float, tuple[float, float, float]]] = {
    "ring_front_center": (0.01, 0.02, -0.01, (1.63, -0.01, 1.05)),
    "ring_front_left": (0.75, 0.03, 0.02, (1.50, 0.26, 1.06)),
    "ring_rear_right": (-2.65, 0.01, 0.03, (1.05, -0.14, 1.07)),
}
UP_LIDAR = (1.35, 0.02, 1.31)


def egovehicle_from_camera(name: str) -> FloatArray:
    yaw, pitch, roll, place_m = LOOKS[name]
    right = np.array([np.sin(yaw), -np.cos(yaw), 0.0])
    ahead = np.array([np.cos(yaw) * np.cos(pitch), np.sin(yaw) * np.cos(pitch), -np.sin(pitch)])
    down = np.cross(ahead, right)
    matrix = np.eye(4)
    matrix[:3, 0] = np.cos(roll) * right + np.sin(roll) * down
    matrix[:3, 1] = np.cos(roll) * down - np.sin(roll) * right
    matrix[:3, 2], matrix[:3, 3] = ahead, place_m
    return matrix


def ego_from_camera(name: str) -> FloatArray:
    matrix = egovehicle_from_camera(name)
    matrix[2, 3] += AXLE_HEIGHT_M
    return matrix


def egovehicle_from_lidar() -> FloatArray:
    matrix = np.eye(4)
    angle = 0.02
    matrix[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    matrix[:3, 3] = UP_LIDAR
    return matrix


def intrinsics(name: str) -> FloatArray:
    height, width = IMAGE_HW.get(name, OTHER_HW)
    return np.array([[222.8, 0, width / 2 + 0.6], [0, 222.8, height / 2 - 1.3], [0, 0, 1]])


def city_from_egovehicle(drive: FilmedDrive, time_s: FloatArray) -> FloatArray:
    axle = np.eye(4)
    axle[2, 3] = AXLE_HEIGHT_M
    return drive.world_from_ego(time_s) @ axle


def stream_ns(drive: FilmedDrive, sensor: str) -> list[int]:
    every_s = SWEEP_S if sensor == "lidar" else CAMERA_S
    times_s = np.arange(LATE_S[sensor], drive.seconds, every_s)
    return (BEGIN_NS + (times_s * 1e9).round().astype(np.int64)).tolist()


def seconds(time_ns: Sequence[int] | FloatArray) -> FloatArray:
    """From a log's begin."""
    return (np.asarray(time_ns) - BEGIN_NS) / 1e9


# The car ahead, in Argoverse's ego frame, and a sign beside the road.
AHEAD_M, ASIDE_M = (12.0, 0.4, 0.6), (6.0, -5.0, 1.0)


def write_log(folder: Path, drive: FilmedDrive, lidar: bool = False, boxes: bool = True) -> Path:
    """Write all files of a log that a converter may read; returns `folder`."""
    for name in LOOKS:
        _write_images(folder / "sensors" / "cameras" / name, drive, name)
    stamps = sorted({time_ns for sensor in LATE_S for time_ns in stream_ns(drive, sensor)})
    # Poses come for all sensors, in no order.
    mixed = np.random.default_rng(3).permutation(np.array(stamps))
    _write(
        folder / "city_SE3_egovehicle.feather",
        {"timestamp_ns": mixed, **_pose_columns(city_from_egovehicle(drive, seconds(mixed)))},
    )
    mountings = {name: egovehicle_from_camera(name) for name in LOOKS}
    mountings |= {"up_lidar": egovehicle_from_lidar(), "down_lidar": egovehicle_from_lidar()}
    columns = _pose_columns(np.stack(list(mountings.values())))
    calibration = folder / "calibration"
    _write(
        calibration / "egovehicle_SE3_sensor.feather", {"sensor_name": list(mountings), **columns}
    )
    matrices = np.stack([intrinsics(name) for name in LOOKS])
    sizes = [IMAGE_HW.get(name, OTHER_HW) for name in LOOKS]
    _write(
        calibration / "intrinsics.feather",
        {
            "sensor_name": list(LOOKS),
            "fx_px": matrices[:, 0, 0],
            "fy_px": matrices[:, 1, 1],
            "cx_px": matrices[:, 0, 2],
            "cy_px": matrices[:, 1, 2],
            # Of the lens before the images were undistorted.
            "k1": [-0.25] * len(LOOKS),
            "k2": [-0.14] * len(LOOKS),
            "k3": [0.21] * len(LOOKS),
            "height_px": [height for height, _ in sizes],
            "width_px": [width for _, width in sizes],
        },
    )
    if lidar:
        _write_sweeps(folder / "sensors" / "lidar", drive)
    if boxes:
        _write_boxes(folder / "annotations.feather", drive)
    return folder


def _write(path: Path, columns: dict[str, object]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    feather.write_feather(pa.table(columns), str(path), compression="zstd")


def _pose_columns(poses: FloatArray) -> dict[str, FloatArray]:
    columns = dict(zip(("qw", "qx", "qy", "qz"), quaternion_of(poses).T, strict=True))
    return columns | dict(zip(("tx_m", "ty_m", "tz_m"), poses[:, :3, 3].T, strict=True))


def _write_images(folder: Path, drive: FilmedDrive, name: str) -> None:
    """A picture every fourth of a second; those between are links to it."""
    folder.mkdir(parents=True)
    last = folder
    for number, time_ns in enumerate(stream_ns(drive, name)):
        path = folder / f"{time_ns}.jpg"
        if number % 5:
            path.hardlink_to(last)
            continue
        height_width = IMAGE_HW.get(name, OTHER_HW)
        time_s = float(seconds([time_ns])[0])
        image = drive.picture(intrinsics(name), ego_from_camera(name), height_width, time_s)
        Image.fromarray(image).save(path, quality=90)
        last = path


def _write_sweeps(folder: Path, drive: FilmedDrive) -> None:
    """Points in Argoverse's ego frame: one ahead, one to the left."""
    for number, time_ns in enumerate(stream_ns(drive, "lidar")):
        _write(
            folder / f"{time_ns}.feather",
            {
                "x": np.array([9.0, 0.5], dtype=np.float16),
                "y": np.array([0.25 * number, 7.0], dtype=np.float16),
                "z": np.array([-0.25, 1.5], dtype=np.float16),
                "intensity": np.array([17, 255], dtype=np.uint8),
                "laser_number": np.array([3, 40], dtype=np.uint8),
                "offset_ns": np.array([0, 99_000_000], dtype=np.int32),
            },
        )


def _write_boxes(path: Path, drive: FilmedDrive) -> None:
    """Two boxes a sweep: a car ahead that turns with ours, and a sign."""
    stamps = stream_ns(drive, "lidar")
    places = np.tile([AHEAD_M, ASIDE_M], (len(stamps), 1))
    poses = np.tile(np.eye(4), (len(places), 1, 1))
    poses[:, :3, 3] = places
    _write(
        path,
        {
            "timestamp_ns": np.repeat(stamps, 2),
            "track_uuid": ["a-car", "a-sign"] * len(stamps),
            "category": ["REGULAR_VEHICLE", "SIGN"] * len(stamps),
            "length_m": [4.5, 0.2] * len(stamps),
            "width_m": [1.9, 0.6] * len(stamps),
            "height_m": [1.6, 0.7] * len(stamps),
            **_pose_columns(poses),
            "num_interior_pts": np.full(len(places), 9),
        },
    )


def lidar_from_egovehicle() -> FloatArray:
    return invert(egovehicle_from_lidar())
