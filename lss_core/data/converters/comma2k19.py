"""comma2k19: minutes of highway from a phone on the windshield, with poses by GNSS, IMU and images.

    SRC/Chunk_1/b0c9d2329ad1606b|2018-08-02--08-34-47/40/
        video.hevc
        global_pose/frame_times, frame_positions, frame_orientations    (NumPy arrays, no ending)

A folder of routes without chunks will do, too.
"""

import logging
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from lss_core.data.converters.drive import CameraTrack, Drive, FoundDrive
from lss_core.data.converters.video_frames import decode_frames, import_av
from lss_core.errors import DataError
from lss_core.geometry import FloatArray, invert, rigid_from_quaternion

logger = logging.getLogger(__name__)

# Of all devices, as in the data set's utils/camera.py. The lens' distortion is not known.
FOCAL_PX, IMAGE_HW = 910.0, (874, 1164)
INTRINSICS = np.array(
    [[FOCAL_PX, 0.0, IMAGE_HW[1] / 2], [0.0, FOCAL_PX, IMAGE_HW[0] / 2], [0.0, 0.0, 1.0]]
)
# The height that openpilot, the device's own software, begins its calibration with.
DEVICE_HEIGHT_M = 1.22
# No document says how far the windshield's device is ahead of the rear axle: a guess from the wheel
# bases of both cars, 2.66 m and 2.70 m, with the device somewhat behind their middle to the front.
DEVICE_AHEAD_M = 1.5
# x forward, y right, z down, from a camera's x right, y down, z forward.
DEVICE_FROM_CAMERA = np.array([[0.0, 0, 1, 0], [1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 1]])
CHANNEL = "CAM_FRONT"
FRAMES_A_KEYFRAME = 10  # of 20 a second

# What is driven straight shows where the car's front is.
_STRAIGHT_RADPS, _MOVING_MPS = np.radians(2.0), 5.0
_STRAIGHT_FRAMES = 40
# No windshield holds it further off.
_MOST_TURNED = np.radians(25.0)
# Squares of the ellipsoid's half axes, of WGS 84.
_EQUATOR_M2, _POLE_M2 = 6_378_137.0**2, 6_356_752.314245**2


class _Poses(NamedTuple):
    """Of a segment: times [P] and the device in earth-centred coordinates [P, 4, 4]."""

    time_s: FloatArray
    ecef_from_device: FloatArray


def find_comma2k19(src: Path, out: Path) -> list[FoundDrive]:
    """The segments below a folder, by route; those whose route never drives straight are left out.

    Poses of all segments of a route are read: they say how the device hangs, and where the origin
    of the route's global frame is. That frame is east, north, up.

    Args:
        src: Folder with chunks, or with routes.
        out: Of the data set: frames of videos become files there.

    Raises:
        DataError: If there is no segment, its files are not as they should be, or the library that
            decodes them is not installed.
    """
    import_av()
    videos = [*src.glob("*|*/*/video.hevc"), *src.glob("*/*|*/*/video.hevc")]
    # Where a file system has no pipes, the data set's own tool makes them underscores.
    videos += [*src.glob("*_*--*/*/video.hevc"), *src.glob("*/*_*--*/*/video.hevc")]
    routes: dict[Path, list[Path]] = {}
    for video in sorted(set(videos), key=lambda path: (path.parents[1], path.parent.name.zfill(4))):
        routes.setdefault(video.parents[1], []).append(video.parent)
    if not routes:
        raise DataError(
            f"'{src}' has no segment of comma2k19: expected folders such as "
            "Chunk_1/b0c9d2329ad1606b|2018-08-02--08-34-47/40/ with a file video.hevc."
        )
    found = []
    for route, segments in routes.items():
        name = route_name(route.name)
        poses = [_poses(segment) for segment in segments]
        ego_from_device = _level(poses)
        if ego_from_device is None:
            logger.warning("Left out: %s, which never drives straight for 2 s.", name)
            continue
        enu_from_ecef = _enu_from_ecef(poses[0].ecef_from_device[0, :3, 3])
        for segment, own in zip(segments, poses, strict=True):
            global_from_ego = enu_from_ecef @ own.ecef_from_device @ invert(ego_from_device)
            track = _Poses(own.time_s, global_from_ego)
            segment_name = f"{name}--{segment.name}"
            read = partial(_read, segment, segment_name, track, ego_from_device, out)
            found.append(FoundDrive(segment_name, read, log=name))
    if not found:
        raise DataError(f"No route in '{src}' drives straight for 2 s, which tells where it looks.")
    return found


def route_name(name: str) -> str:
    """A route's name without its pipe, which shells and some file systems take ill."""
    return name.replace("|", "_")


def _read(segment: Path, name: str, track: _Poses, ego_from_device: FloatArray, out: Path) -> Drive:
    rows = np.arange(0, len(track.time_s), FRAMES_A_KEYFRAME)
    files = decode_frames(
        segment / "video.hevc", rows.tolist(), out / "samples" / CHANNEL, f"{name}__{CHANNEL}__"
    )
    times_s = track.time_s[rows[: len(files)]]
    camera = CameraTrack(INTRINSICS, ego_from_device @ DEVICE_FROM_CAMERA, IMAGE_HW, times_s, files)
    return Drive(track.time_s, track.ecef_from_device, {CHANNEL: camera}, times_s)


def _poses(segment: Path) -> _Poses:
    time_s, places_m, quaternions = (
        _array(segment / "global_pose" / f"frame_{name}", columns)
        for name, columns in (("times", 0), ("positions", 3), ("orientations", 4))
    )
    if not len(time_s) == len(places_m) == len(quaternions) > 1:
        counts = f"{len(time_s)} times, {len(places_m)} places, {len(quaternions)} orientations"
        raise DataError(f"'{segment / 'global_pose'}' has {counts}, which must be as many.")
    # As the data set's utils/camera.py takes them: they turn the device's axes into the earth's.
    return _Poses(time_s, rigid_from_quaternion(places_m, quaternions))


def _array(path: Path, columns: int) -> FloatArray:
    try:
        values: Any = np.load(path, allow_pickle=False)
        return np.asarray(values, dtype=np.float64).reshape((-1, columns) if columns else (-1,))
    except (ValueError, EOFError) as error:
        raise DataError(f"'{path}' is no NumPy array of numbers: {error}.") from error


def _level(segments: list[_Poses]) -> FloatArray | None:
    """`ego_from_device` [4, 4]: x where the car goes when it drives straight, its y level with it.

    A device hangs turned by a few degrees to the side and up or down, which its path shows; that it
    is not turned about its line of sight is taken for granted. None without enough driven straight.
    """
    forward = []
    for time_s, ecef_from_device in segments:
        elapsed_s = np.diff(time_s)[:, None]
        rotation = ecef_from_device[:, :3, :3]
        turned = np.swapaxes(rotation[:-1], -1, -2) @ rotation[1:]
        # Of a small turn, its angles about x, y and z.
        turning = np.stack([turned[:, 2, 1], turned[:, 0, 2], turned[:, 1, 0]], axis=-1) / elapsed_s
        moved_mps = np.diff(ecef_from_device[:, :3, 3], axis=0) / elapsed_s
        seen = (np.swapaxes(rotation[:-1], -1, -2) @ moved_mps[..., None])[..., 0]
        speed = np.linalg.norm(seen, axis=-1)
        is_straight = (np.abs(turning).max(axis=-1) < _STRAIGHT_RADPS) & (speed > _MOVING_MPS)
        forward.append(seen[is_straight] / speed[is_straight, None])
    directions = np.concatenate(forward)
    if len(directions) < _STRAIGHT_FRAMES:
        return None
    x = np.median(directions, axis=0)
    x /= np.linalg.norm(x)
    if x[0] < np.cos(_MOST_TURNED):
        raise DataError(
            f"A car that drives along {np.round(x, 2).tolist()} of its device's axes (forward, "
            "right, down) is none of comma2k19; do frame_orientations turn these into the earth's?"
        )
    y = np.array([0.0, -1.0, 0.0])  # the device's left
    y -= (y @ x) * x
    y /= np.linalg.norm(y)
    ego_from_device = np.eye(4)
    ego_from_device[:3, :3] = [x, y, np.cross(x, y)]
    ego_from_device[:3, 3] = [DEVICE_AHEAD_M, 0.0, DEVICE_HEIGHT_M]
    return ego_from_device


def _enu_from_ecef(origin_m: FloatArray) -> FloatArray:
    """East, north, up [4, 4] at a place near the earth's ellipsoid: up is across its surface."""
    up = origin_m / [_EQUATOR_M2, _EQUATOR_M2, _POLE_M2]
    up /= np.linalg.norm(up)
    east = np.cross([0.0, 0.0, 1.0], up)
    east /= np.linalg.norm(east)
    enu_from_ecef = np.eye(4)
    enu_from_ecef[:3, :3] = [east, np.cross(up, east), up]
    enu_from_ecef[:3, 3] = -enu_from_ecef[:3, :3] @ origin_m
    return enu_from_ecef
