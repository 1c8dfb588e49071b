"""A recorded scene as rows of the nuScenes tables."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from lss_core.data.writing.table_rows import Row, chain, token
from lss_core.geometry import FloatArray, interpolate_poses, quaternion_of

LIDAR = "LIDAR_TOP"
# Of rows that have a pose and no file: without a lidar, a scene's path is made of all its rows.
POSES = "EGO_POSE"


@dataclass(frozen=True)
class Mounting:
    """Where a sensor is.

    Attributes:
        ego_from_sensor: [4, 4].
        rawpixel_from_camera: [3, 3] of a camera.
        image_hw: Of a camera.
    """

    ego_from_sensor: FloatArray
    rawpixel_from_camera: FloatArray | None = None
    image_hw: tuple[int, int] = (0, 0)


@dataclass(frozen=True)
class Frame:
    """A file of one sensor.

    Attributes:
        channel: Of the sensor.
        time_us: When it was taken.
        filename: Relative to the data root.
        keyframe: Number of the keyframe whose file it is; None between keyframes.
    """

    channel: str
    time_us: int
    filename: str = ""
    keyframe: int | None = None


@dataclass(frozen=True)
class Box:
    """An object at a keyframe.

    Attributes:
        category: Its kind.
        size_m: [3] length, width, height.
        global_from_box: [4, 4].
    """

    category: str
    size_m: FloatArray
    global_from_box: FloatArray


@dataclass
class Recording:
    """What is known of a scene; all of it fits together.

    Attributes:
        name: Of the scene.
        time_us: [P] of its poses, increasing.
        global_from_ego: [P, 4, 4].
        mountings: By channel.
        keyframes_us: Their times, increasing.
        frames: By channel and time.
        boxes: By object and keyframe.
    """

    name: str
    time_us: NDArray[np.int64]
    global_from_ego: FloatArray
    mountings: dict[str, Mounting] = field(default_factory=dict)
    keyframes_us: list[int] = field(default_factory=list)
    frames: dict[tuple[str, int], Frame] = field(default_factory=dict)
    boxes: dict[str, dict[int, Box]] = field(default_factory=dict)


def scene_token(recording: Recording, *parts: object) -> str:
    """Token of the scene, or of `parts` of it."""
    return token("scene", recording.name, *parts)


def scene_rows(recording: Recording) -> dict[str, list[Row]]:
    """Rows of one scene by table, without those of tables that scenes share."""
    mountings = dict(recording.mountings)
    frames = list(recording.frames.values())
    if LIDAR not in mountings:
        mountings[POSES] = Mounting(np.eye(4))
        frames += [Frame(POSES, time_us) for time_us in recording.time_us.tolist()]
    order = {channel: number for number, channel in enumerate(mountings)}
    frames.sort(key=lambda frame: (order[frame.channel], frame.time_us))
    instances, annotations = _box_rows(recording)
    return {
        "calibrated_sensor": [
            _calibration_row(recording, channel, mounting)
            for channel, mounting in mountings.items()
        ],
        "ego_pose": _pose_rows(recording, frames),
        "sample": _sample_rows(recording),
        "sample_data": _data_rows(recording, frames, mountings),
        "instance": instances,
        "sample_annotation": annotations,
    }


def _calibration_row(recording: Recording, channel: str, mounting: Mounting) -> Row:
    matrix = mounting.rawpixel_from_camera
    return {
        "token": scene_token(recording, "calibrated_sensor", channel),
        "sensor_token": token("sensor", channel),
        "translation": mounting.ego_from_sensor[:3, 3].tolist(),
        "rotation": quaternion_of(mounting.ego_from_sensor).tolist(),
        "camera_intrinsic": [] if matrix is None else matrix.tolist(),
    }


def _pose_rows(recording: Recording, frames: list[Frame]) -> list[Row]:
    """The car at the times of frames."""
    # From the first pose on: seconds since 1970 have too many digits.
    first_us = recording.time_us[0]
    poses = interpolate_poses(
        (recording.time_us - first_us) / 1e6,
        recording.global_from_ego,
        (np.asarray([frame.time_us for frame in frames]) - first_us) / 1e6,
    )
    return [
        {
            "token": scene_token(recording, frame.channel, frame.time_us),
            "timestamp": frame.time_us,
            "rotation": quaternion,
            "translation": place_m,
        }
        for frame, quaternion, place_m in zip(
            frames, quaternion_of(poses).tolist(), poses[:, :3, 3].tolist(), strict=True
        )
    ]


def _sample_rows(recording: Recording) -> list[Row]:
    rows: list[Row] = [
        {
            "token": scene_token(recording, "sample", time_us),
            "timestamp": time_us,
            "scene_token": scene_token(recording),
        }
        for time_us in recording.keyframes_us
    ]
    chain(rows)
    return rows


def _data_rows(
    recording: Recording, frames: list[Frame], mountings: dict[str, Mounting]
) -> list[Row]:
    keyframes_us = recording.keyframes_us
    by_channel: dict[str, list[Row]] = {channel: [] for channel in mountings}
    for frame in frames:
        # As in nuScenes, what is no keyframe belongs to the one that follows.
        after = min(int(np.searchsorted(keyframes_us, frame.time_us)), len(keyframes_us) - 1)
        number = after if frame.keyframe is None else frame.keyframe
        row_token = scene_token(recording, frame.channel, frame.time_us)
        height, width = mountings[frame.channel].image_hw
        by_channel[frame.channel].append({
            "token": row_token,
            "sample_token": scene_token(recording, "sample", keyframes_us[number]),
            "ego_pose_token": row_token,
            "calibrated_sensor_token": scene_token(recording, "calibrated_sensor", frame.channel),
            "timestamp": frame.time_us,
            "fileformat": frame.filename.rpartition(".")[-1],
            "is_key_frame": frame.keyframe is not None,
            "height": height,
            "width": width,
            "filename": frame.filename,
        })  # fmt: skip
    for rows in by_channel.values():
        chain(rows)
    return [row for rows in by_channel.values() for row in rows]


def _box_rows(recording: Recording) -> tuple[list[Row], list[Row]]:
    """Rows of `instance` and of `sample_annotation`."""
    instances, annotations = [], []
    for name, boxes in recording.boxes.items():
        own = [_annotation_row(recording, name, n, boxes[n]) for n in sorted(boxes)]
        chain(own)
        annotations += own
        instances.append({
            "token": scene_token(recording, "instance", name),
            "category_token": token("category", next(iter(boxes.values())).category),
            "nbr_annotations": len(own),
            "first_annotation_token": own[0]["token"],
            "last_annotation_token": own[-1]["token"],
        })  # fmt: skip
    return instances, annotations


def _annotation_row(recording: Recording, name: str, keyframe: int, box: Box) -> Row:
    length_m, width_m, height_m = box.size_m.tolist()
    time_us = recording.keyframes_us[keyframe]
    return {
        "token": scene_token(recording, "annotation", name, time_us),
        "sample_token": scene_token(recording, "sample", time_us),
        "instance_token": scene_token(recording, "instance", name),
        "visibility_token": "",
        "attribute_tokens": [],
        "translation": box.global_from_box[:3, 3].tolist(),
        "size": [width_m, length_m, height_m],
        "rotation": quaternion_of(box.global_from_box).tolist(),
        "num_lidar_pts": 0,
        "num_radar_pts": 0,
    }
