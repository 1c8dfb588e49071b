"""A folder laid out as KITTI's raw recordings, of drives that are known."""

from pathlib import Path

import numpy as np
from filmed_drive import FilmedDrive
from PIL import Image

from lss_core.geometry import FloatArray, invert

DATE = "2011_09_26"
HEIGHT, WIDTH, FOCAL_PX, CENTRE = 94, 310, 180.3, (152.4, 43.2)
# The first place; seconds from a drive's begin to the first of each stream.
LATITUDE, LONGITUDE, ALTITUDE_M = 49.0111, 8.4228, 112.8
LATE_S = {"oxts": 0.0, "image_02": 0.013, "image_03": 0.017, "velodyne_points": 0.021}
PERIOD_S = 0.1
IMU_IN_EGO_M = (-0.05, 0.32, 0.93)


def turned(angles: tuple[float, float, float], axes: FloatArray) -> FloatArray:
    """`axes` [3, 3], turned by small angles about x, y and z one after the other."""
    for angle, (one, other) in zip(angles, ((1, 2), (2, 0), (0, 1)), strict=True):
        turn = np.eye(3)
        turn[one, one] = turn[other, other] = np.cos(angle)
        turn[one, other], turn[other, one] = -np.sin(angle), np.sin(angle)
        axes = turn @ axes
    return axes


def rigid(rotation: FloatArray, place_m: object) -> FloatArray:
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation, place_m
    return matrix


AHEAD = np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]])
VELO_FROM_IMU = rigid(turned((0.01, -0.006, 0.004), np.eye(3)), (-0.81, 0.32, -0.80))
CAMERA0_FROM_VELO = rigid(turned((-0.008, 0.005, 0.011), AHEAD.T), (-0.004, -0.076, -0.272))
RECT_FROM_CAMERA0 = rigid(turned((0.004, 0.009, -0.007), np.eye(3)), (0.0, 0.0, 0.0))
# Of the rectified cameras, in the rectified camera 0: to the right, down, ahead.
CAMERA_IN_RECT_M = {"02": (-0.06, 0.001, -0.003), "03": (0.47, -0.002, 0.004)}


def ego_from_velo() -> FloatArray:
    return rigid(np.eye(3), IMU_IN_EGO_M) @ invert(VELO_FROM_IMU)


def ego_from_camera(number: str) -> FloatArray:
    rect = ego_from_velo() @ invert(RECT_FROM_CAMERA0 @ CAMERA0_FROM_VELO)
    return rect @ rigid(np.eye(3), CAMERA_IN_RECT_M[number])


def intrinsics() -> FloatArray:
    return np.array([[FOCAL_PX, 0, CENTRE[0]], [0, FOCAL_PX, CENTRE[1]], [0, 0, 1]])


def stream_s(drive: FilmedDrive, stream: str) -> FloatArray:
    """When each frame was taken; the last of a stream must not be after the drive's end."""
    return np.arange(LATE_S[stream], drive.seconds + 1e-9, PERIOD_S)


def write_kitti_raw(src: Path, drives: dict[str, FilmedDrive], lidar: bool = False) -> Path:
    """Write all files that a converter may read; returns `src`."""
    day = src / DATE
    for number, drive in drives.items():
        _write_drive(day / f"{DATE}_drive_{number}_sync", drive, lidar)
    lines = ["calib_time: 09-Jan-2012 13:57:47", "corner_dist: 9.950000e-02"]
    for number in ("00", "01", "02", "03"):
        place = np.array(CAMERA_IN_RECT_M.get(number, (0.0, 0.0, 0.0)))
        projection = intrinsics() @ np.hstack([np.eye(3), -place[:, None]])
        lines += [f"S_rect_{number}: {WIDTH:e} {HEIGHT:e}"]
        lines += [f"R_rect_{number}: {_text(RECT_FROM_CAMERA0[:3, :3])}"]
        lines += [f"P_rect_{number}: {_text(projection)}"]
    (day / "calib_cam_to_cam.txt").write_text("\n".join(lines) + "\n")
    for name, matrix in (("imu_to_velo", VELO_FROM_IMU), ("velo_to_cam", CAMERA0_FROM_VELO)):
        (day / f"calib_{name}.txt").write_text(
            f"calib_time: 25-May-2012 16:47:16\nR: {_text(matrix[:3, :3])}\n"
            f"T: {_text(matrix[:3, 3])}\n"
        )
    return src


def _text(numbers: FloatArray) -> str:
    return " ".join(f"{number:.9e}" for number in numbers.reshape(-1))


def _write_drive(folder: Path, drive: FilmedDrive, lidar: bool) -> None:
    begin = np.datetime64("2011-09-26T13:02:25.594360375")
    for stream in LATE_S:
        times_s = stream_s(drive, stream)
        (folder / stream / "data").mkdir(parents=True)
        stamps = begin + (times_s * 1e9).round().astype("timedelta64[ns]")
        text = "".join(f"{str(stamp).replace('T', ' ')}\n" for stamp in stamps)
        (folder / stream / "timestamps.txt").write_text(text)
        for number, time_s in enumerate(times_s.tolist()):
            path = folder / stream / "data" / f"{number:010d}"
            if stream == "oxts":
                path.with_suffix(".txt").write_text(_oxts(drive, time_s) + "\n")
            elif stream.startswith("image"):
                _write_image(path.with_suffix(".png"), drive, stream[-2:], time_s, number)
            elif lidar:
                points = np.array([[8.0, 1.0 + number, -1.7, 0.25], [0.0, -9.0, -1.5, 1.0]])
                points.astype(np.float32).tofile(path.with_suffix(".bin"))


def _oxts(drive: FilmedDrive, time_s: float) -> str:
    """30 numbers; east and north by the sphere's arcs, which for short ways are its latitudes."""
    imu = drive.world_from_ego(time_s) @ rigid(np.eye(3), IMU_IN_EGO_M)
    rotation, (east_m, north_m, up_m) = imu[:3, :3], imu[:3, 3]
    radius_m = 6_378_137.0
    latitude = LATITUDE + np.degrees(north_m / radius_m)
    longitude = LONGITUDE + np.degrees(east_m / radius_m / np.cos(np.radians(LATITUDE)))
    roll = np.arctan2(rotation[2, 1], rotation[2, 2])
    pitch = -np.arcsin(rotation[2, 0])
    yaw = np.arctan2(rotation[1, 0], rotation[0, 0])
    numbers = [latitude, longitude, ALTITUDE_M + up_m, roll, pitch, yaw, *[0.0] * 19]
    return " ".join(f"{number:.12f}" for number in numbers) + " 4 10 4 4 0"


def _write_image(path: Path, drive: FilmedDrive, camera: str, time_s: float, number: int) -> None:
    """A picture every half second; those between, which are never wanted, are links to it."""
    if number % 5:
        last = path.with_name(f"{number // 5 * 5:010d}.png")
        path.hardlink_to(last)
        return
    image = drive.picture(intrinsics(), ego_from_camera(camera), (HEIGHT, WIDTH), time_s)
    Image.fromarray(image).save(path)
