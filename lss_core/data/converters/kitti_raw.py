"""KITTI's raw recordings, synced and rectified: poses by GPS and IMU, two colour cameras, a lidar.

SRC/2011_09_26/calib_cam_to_cam.txt, calib_imu_to_velo.txt, calib_velo_to_cam.txt
SRC/2011_09_26/2011_09_26_drive_0001_sync/
    image_02/, image_03/, velodyne_points/    timestamps.txt, data/0000000000.png or .bin
    oxts/                                     timestamps.txt, data/0000000000.txt
"""

from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from scipy.spatial.transform import Rotation

from lss_core.data.converters.drive import CameraTrack, Drive, FoundDrive, SweepTrack
from lss_core.errors import DataError
from lss_core.geometry import FloatArray, invert

# Where the GPS/IMU unit is, by the drawing of the sensors (cvlibs.net/datasets/kitti/setup.php):
# 0.93 m above the road. The wheel base is 2.71 m, camera 0 lies 1.68 m behind the front axle and
# 1.08 m ahead of the unit, which is thus 0.05 m behind the rear axle; and it is 0.32 m left of the
# lidar, which stands in the middle of the car.
EGO_FROM_IMU = np.array(
    [[1.0, 0, 0, -0.05], [0, 1, 0, 0.32], [0, 0, 1, 0.93], [0, 0, 0, 1]], dtype=np.float64
)
CHANNELS = {"02": "CAM_FRONT", "03": "CAM_FRONT_STEREO"}
# Of the sphere on which KITTI's own tools lay latitude and longitude out, Mercator's way.
_EARTH_M = 6_378_137.0
_SUFFIX = "_sync"


def find_kitti_raw(src: Path, lidar: bool = False) -> list[FoundDrive]:
    """The drives below a folder.

    Args:
        src: Folder with a folder for each date.
        lidar: Read the sweeps, too.

    Raises:
        DataError: If there is none.
    """
    folders = sorted(src.glob(f"*/*_drive_*{_SUFFIX}"))
    if not folders:
        raise DataError(
            f"'{src}' has no drive of KITTI raw: expected folders such as "
            f"2011_09_26/2011_09_26_drive_0001{_SUFFIX} (synced and rectified)."
        )
    return [
        FoundDrive(folder.name.removesuffix(_SUFFIX), partial(_read, folder, lidar))
        for folder in folders
    ]


def _read(folder: Path, lidar: bool) -> Drive:
    ego_from_velo = EGO_FROM_IMU @ invert(_rigid(folder.parent / "calib_imu_to_velo.txt"))
    cameras = {
        channel: _camera(folder, number, ego_from_velo)
        for number, channel in CHANNELS.items()
        if (folder / f"image_{number}").is_dir()
    }
    if not cameras:
        raise DataError(f"'{folder}' has neither image_02 nor image_03, its colour cameras.")
    oxts_s, files = _files(folder / "oxts", "*.txt")
    poses = poses_of_oxts(np.array([file.read_text().split()[:6] for file in files], dtype=float))
    sweeps = _sweeps(folder / "velodyne_points", ego_from_velo) if lidar else None
    moments = next(iter(cameras.values())) if sweeps is None else sweeps
    return Drive(oxts_s, poses, cameras, moments.time_s, sweeps)


def poses_of_oxts(oxts: FloatArray) -> FloatArray:
    """`global_from_ego` [P, 4, 4] of latitude, longitude (degrees), altitude (m), roll, pitch, yaw.

    Global is x east, y north, z up, from the first place on. A yaw of 0 is east, positive to the
    left; a positive roll has the left side up, a positive pitch the front down.

    Args:
        oxts: [P, 6].
    """
    scale_m = np.cos(np.radians(oxts[0, 0])) * _EARTH_M
    poses = np.tile(np.eye(4), (len(oxts), 1, 1))
    poses[:, 0, 3] = scale_m * np.radians(oxts[:, 1])
    poses[:, 1, 3] = scale_m * np.log(np.tan(np.radians(90.0 + oxts[:, 0]) / 2.0))
    poses[:, 2, 3] = oxts[:, 2]
    poses[:, :3, 3] -= poses[0, :3, 3]
    poses[:, :3, :3] = Rotation.from_euler("ZYX", oxts[:, [5, 4, 3]]).as_matrix()
    return poses @ invert(EGO_FROM_IMU)


def _camera(folder: Path, number: str, ego_from_velo: FloatArray) -> CameraTrack:
    """A rectified camera: P_rect = K [I | t] acts in rectified coordinates of camera 0."""
    calibration = _numbers(folder.parent / "calib_cam_to_cam.txt")
    projection = calibration[f"P_rect_{number}"].reshape(3, 4)
    rect_from_camera0 = np.eye(4)
    rect_from_camera0[:3, :3] = calibration["R_rect_00"].reshape(3, 3)
    camera0_from_velo = _rigid(folder.parent / "calib_velo_to_cam.txt")
    ego_from_rect = ego_from_velo @ invert(rect_from_camera0 @ camera0_from_velo)
    time_s, files = _files(folder / f"image_{number}", "*.[pj][np]g")
    with Image.open(files[0]) as image:
        width, height = image.size
    mounting = ego_from_rect @ rect_from_projection(projection)
    return CameraTrack(projection[:, :3], mounting, (height, width), time_s, files)


def rect_from_projection(projection: FloatArray) -> FloatArray:
    """`camera0_from_camera` [4, 4] of a rectified camera's projection K [I | t], [3, 4]."""
    camera0_from_camera = np.eye(4)
    camera0_from_camera[:3, 3] = -np.linalg.solve(projection[:, :3], projection[:, 3])
    return camera0_from_camera


def _sweeps(folder: Path, ego_from_velo: FloatArray) -> SweepTrack:
    time_s, files = _files(folder, "*.bin")

    def load(number: int) -> NDArray[np.float32]:
        points = np.fromfile(files[number], dtype=np.float32).reshape(-1, 4)
        points[:, 3] *= 255.0  # reflectance, 0 to 1
        return points

    return SweepTrack(ego_from_velo, time_s, load)


def _files(folder: Path, pattern: str) -> tuple[FloatArray, list[Path]]:
    """Times in seconds and files of a stream; a frame that was lost has a time and no file."""
    lines = (folder / "timestamps.txt").read_text().splitlines()
    times = np.array([line for line in lines if line.strip()], dtype="datetime64[ns]")
    files = sorted((folder / "data").glob(pattern))
    if not files:
        raise DataError(f"'{folder / 'data'}' has no files.")
    numbers = [int(file.stem) for file in files]
    if numbers[-1] >= len(times):
        raise DataError(
            f"'{folder}' has {len(times)} time stamps, but a file '{files[-1].name}'; they are "
            "counted from 0."
        )
    return times[numbers].astype(np.int64) / 1e9, files


def _rigid(path: Path) -> FloatArray:
    calibration = _numbers(path)
    matrix = np.eye(4)
    matrix[:3, :3] = calibration["R"].reshape(3, 3)
    matrix[:3, 3] = calibration["T"]
    return matrix


def _numbers(path: Path) -> dict[str, FloatArray]:
    """Lines `name: numbers`; others, as the date, are left out."""
    found = {}
    for line in path.read_text().splitlines():
        name, _, text = line.partition(":")
        try:
            found[name] = np.array(text.split(), dtype=float)
        except ValueError:
            continue
    return found
