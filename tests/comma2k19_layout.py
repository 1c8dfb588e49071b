"""A folder laid out as comma2k19's, of drives that are known."""

from fractions import Fraction
from pathlib import Path

import av
import numpy as np
from filmed_drive import FilmedDrive

from lss_core.geometry import FloatArray, quaternion_of

IMAGE_HW, FOCAL_PX = (874, 1164), 910.0
INTRINSICS = np.array([[FOCAL_PX, 0, 582.0], [0, FOCAL_PX, 437.0], [0, 0, 1]])
FRAME_S, BEGIN_S = 0.05, 842.37
# Between San Jose and San Francisco.
LATITUDE, LONGITUDE, HEIGHT_M = np.radians(37.4241), np.radians(-122.1532), 61.0
# How the device hangs: turned to the left, its front down; where, seen from the rear axle.
DEVICE_LEFT, DEVICE_DOWN, DEVICE_M = 0.03, 0.05, (1.5, 0.0, 1.22)


def ego_from_device() -> FloatArray:
    """The device's axes are forward, right, down."""
    cos, sin = np.cos(DEVICE_LEFT), np.sin(DEVICE_LEFT)
    forward = np.array([cos * np.cos(DEVICE_DOWN), sin * np.cos(DEVICE_DOWN), -np.sin(DEVICE_DOWN)])
    right = np.array([sin, -cos, 0.0])
    matrix = np.eye(4)
    matrix[:3, :3] = np.stack([forward, right, np.cross(forward, right)], axis=-1)
    matrix[:3, 3] = DEVICE_M
    return matrix


def ego_from_camera() -> FloatArray:
    """The camera's axes are right, down, forward."""
    matrix = ego_from_device()
    matrix[:3, :3] = matrix[:3, [1, 2, 0]]
    return matrix


def ecef_from_world() -> FloatArray:
    """Earth-centred from east, north, up at a place on WGS 84, by the textbook."""
    axis_m, flatness = 6_378_137.0, 1.0 / 298.257223563
    square = flatness * (2.0 - flatness)
    sin_lat, cos_lat, sin_lon, cos_lon = (
        f(angle) for angle in (LATITUDE, LONGITUDE) for f in (np.sin, np.cos)
    )
    radius_m = axis_m / np.sqrt(1.0 - square * sin_lat**2)
    matrix = np.eye(4)
    matrix[:3, 0] = (-sin_lon, cos_lon, 0.0)
    matrix[:3, 1] = (-sin_lat * cos_lon, -sin_lat * sin_lon, cos_lat)
    matrix[:3, 2] = (cos_lat * cos_lon, cos_lat * sin_lon, sin_lat)
    matrix[:3, 3] = (radius_m + HEIGHT_M) * matrix[:3, 2]
    matrix[2, 3] = (radius_m * (1.0 - square) + HEIGHT_M) * sin_lat
    return matrix


def frame_times_s(drive: FilmedDrive) -> FloatArray:
    return np.arange(0.0, drive.seconds, FRAME_S)


def sky(frame: int) -> tuple[int, int, int]:
    """A grey for each half second, by which frames are told apart."""
    return (90 + 10 * (frame // 10),) * 3


def write_segment(folder: Path, drive: FilmedDrive) -> Path:
    """Write video and poses of a segment; returns `folder`."""
    times_s = frame_times_s(drive)
    poses = ecef_from_world() @ drive.world_from_ego(times_s) @ ego_from_device()
    arrays = {
        "frame_times": BEGIN_S + times_s,
        "frame_positions": poses[:, :3, 3],
        "frame_orientations": quaternion_of(poses),
    }
    (folder / "global_pose").mkdir(parents=True)
    for name, array in arrays.items():
        with (folder / "global_pose" / name).open("wb") as stream:
            np.save(stream, array)
    _write_video(folder / "video.hevc", drive, len(times_s))
    return folder


def _write_video(path: Path, drive: FilmedDrive, num_frames: int) -> None:
    """Every tenth frame is another; those between, which are never wanted, repeat it."""
    height, width = IMAGE_HW
    with av.open(str(path), "w", format="hevc") as container:
        stream = container.add_stream("libx265", rate=20)
        stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
        stream.time_base = Fraction(1, 20)
        stream.options = {"preset": "ultrafast", "crf": "20", "x265-params": "log-level=none"}
        for number in range(num_frames):
            if number % 10 == 0:
                # Half as fine as the camera, which nobody sees and takes a fourth of the time.
                half = np.diag([0.5, 0.5, 1.0]) @ INTRINSICS
                picture = drive.picture(
                    half, ego_from_camera(), (height // 2, width // 2), float(number * FRAME_S)
                )
                image = picture.repeat(2, axis=0).repeat(2, axis=1)
                image[:60] = sky(number)
            frame = av.VideoFrame.from_ndarray(image, format="rgb24")
            frame.pts = number
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
