"""A hand-made data set in nuScenes' table format: a car on circular arcs, tiny real JPEGs."""

import json
import math
import shutil
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from lss_core.config import CAMERAS

T0_US = 1_532_402_927_000_000
VERSION = "v1.0-trainval"


@dataclass(frozen=True)
class TinyScene:
    """A car that drives an arc at constant speed and yaw rate; its name decides the split."""

    name: str
    seconds: float = 8.0
    speed_mps: float = 6.0
    yaw_rate_radps: float = 0.1
    x_m: float = 400.0
    y_m: float = 900.0
    yaw_rad: float = 0.7
    description: str = "Made by hand"
    has_lidar: bool = True

    def pose(self, time_s: float) -> tuple[float, float, float]:
        """x, y, yaw in `global`, seconds after the start."""
        yaw = self.yaw_rad + self.yaw_rate_radps * time_s
        if self.yaw_rate_radps == 0.0:
            way_m = self.speed_mps * time_s
            return (
                self.x_m + way_m * math.cos(yaw),
                self.y_m + way_m * math.sin(yaw),
                yaw,
            )
        radius_m = self.speed_mps / self.yaw_rate_radps
        return (
            self.x_m + radius_m * (math.sin(yaw) - math.sin(self.yaw_rad)),
            self.y_m - radius_m * (math.cos(yaw) - math.cos(self.yaw_rad)),
            yaw,
        )


TRAIN_A = TinyScene("scene-0001")
TRAIN_B = TinyScene("scene-0002", speed_mps=3.0, yaw_rate_radps=-0.2, yaw_rad=-2.8)
VAL = TinyScene("scene-0003", speed_mps=10.0, yaw_rate_radps=0.0, yaw_rad=2.5)
# Rows of these scenes: 17 keyframes in 8 s, of which those at 0 s ... 3 s have a whole future.
KEYFRAMES_A_SCENE = 17
KEPT_A_SCENE = 7
SWEEPS_A_SCENE = 81
SWEEPS_KEPT_A_SCENE = 31


def camera_delay_s(camera: int) -> float:
    """When a camera fires, relative to the lidar's time stamp of the same keyframe."""
    return -0.04 + 0.01 * camera


def write_tiny(
    root: Path,
    scenes: Sequence[TinyScene] = (TRAIN_A, TRAIN_B, VAL),
    version: str = VERSION,
    cameras: Sequence[str] = CAMERAS,
    image_hw: tuple[int, int] = (90, 160),
) -> Path:
    """Write tables, images and keyframe sweeps; returns `root`."""
    tables: dict[str, list[dict[str, Any]]] = {
        name: []
        for name in (
            "attribute",
            "calibrated_sensor",
            "category",
            "ego_pose",
            "instance",
            "log",
            "map",
            "sample",
            "sample_annotation",
            "sample_data",
            "scene",
            "sensor",
            "visibility",
        )
    }
    for channel in ("LIDAR_TOP", *cameras):
        modality = "lidar" if channel == "LIDAR_TOP" else "camera"
        tables["sensor"].append({"token": channel, "channel": channel, "modality": modality})
        (root / "samples" / channel).mkdir(parents=True, exist_ok=True)
    tables["map"].append(
        {
            "token": "map",
            "log_tokens": [scene.name for scene in scenes],
            "category": "semantic_prior",
            "filename": "maps/empty.png",
        }
    )
    (root / "maps").mkdir(exist_ok=True)
    Image.new("L", (4, 4)).save(root / "maps" / "empty.png")
    for row, scene in enumerate(scenes):
        _write_scene(root, tables, scene, row, tuple(cameras), image_hw)
    (root / version).mkdir(parents=True, exist_ok=True)
    for name, records in tables.items():
        write_table(root, name, records, version)
    return root


def read_table(root: Path, name: str, version: str = VERSION) -> list[dict[str, Any]]:
    """One table of a data set."""
    records: list[dict[str, Any]] = json.loads((root / version / f"{name}.json").read_text())
    return records


def write_table(
    root: Path, name: str, records: Iterable[dict[str, Any]], version: str = VERSION
) -> None:
    """Replace one table of a data set."""
    (root / version / f"{name}.json").write_text(json.dumps(list(records)))


def copy_tiny(source: Path, target: Path) -> Path:
    """A copy that a test may damage."""
    shutil.copytree(source, target)
    return target


def _quaternion_of_yaw(yaw_rad: float) -> list[float]:
    return [math.cos(yaw_rad / 2.0), 0.0, 0.0, math.sin(yaw_rad / 2.0)]


def _camera_quaternion(yaw_rad: float) -> list[float]:
    """Of `ego_from_camera` for a level camera whose z axis points along `yaw_rad`."""
    # Forward: camera x = -ego y, y = -ego z, z = ego x is the quaternion (.5, -.5, .5, -.5).
    cos, sin = math.cos(yaw_rad / 2.0), math.sin(yaw_rad / 2.0)
    w, x, y, z = 0.5, -0.5, 0.5, -0.5
    return [cos * w - sin * z, cos * x - sin * y, cos * y + sin * x, cos * z + sin * w]


def _write_scene(
    root: Path,
    tables: dict[str, list[dict[str, Any]]],
    scene: TinyScene,
    row: int,
    cameras: tuple[str, ...],
    image_hw: tuple[int, int],
) -> None:
    height, width = image_hw
    start_us = T0_US + row * 100_000_000
    num_keyframes = round(scene.seconds / 0.5) + 1
    num_sweeps = round(scene.seconds / 0.1) + 1
    rng = np.random.default_rng(row)

    def sample_token(number: int) -> str:
        return f"{scene.name}-{number:02d}" if 0 <= number < num_keyframes else ""

    def add_data(
        channel: str, time_s: float, keyframe: int, is_key: bool, name: str, **more: Any
    ) -> None:
        time_us = start_us + round(time_s * 1e6)
        token = f"{scene.name}-{channel}-{time_us}"
        x_m, y_m, yaw_rad = scene.pose(time_s)
        tables["ego_pose"].append(
            {
                "token": token,
                "timestamp": time_us,
                "rotation": _quaternion_of_yaw(yaw_rad),
                "translation": [x_m, y_m, 0.0],
            }
        )
        tables["sample_data"].append(
            {
                "token": token,
                "sample_token": sample_token(keyframe),
                "ego_pose_token": token,
                "calibrated_sensor_token": f"{scene.name}-{channel}",
                "timestamp": time_us,
                "fileformat": name.rsplit(".", 1)[-1],
                "is_key_frame": is_key,
                "height": 0,
                "width": 0,
                "filename": name,
                "prev": "",
                "next": "",
            }
            | more
        )

    tables["log"].append(
        {
            "token": scene.name,
            "logfile": scene.name,
            "vehicle": "tiny",
            "date_captured": "2018-07-24",
            "location": "boston-seaport",
        }
    )
    tables["scene"].append(
        {
            "token": f"token-{scene.name}",
            "log_token": scene.name,
            "name": scene.name,
            "description": scene.description,
            "nbr_samples": num_keyframes,
            "first_sample_token": sample_token(0),
            "last_sample_token": sample_token(num_keyframes - 1),
        }
    )
    tables["calibrated_sensor"].append(
        {
            "token": f"{scene.name}-LIDAR_TOP",
            "sensor_token": "LIDAR_TOP",
            "translation": [1.0, 0.0, 1.8],
            "rotation": _quaternion_of_yaw(-math.pi / 2.0),
            "camera_intrinsic": [],
        }
    )
    for column, channel in enumerate(cameras):
        tables["calibrated_sensor"].append(
            {
                "token": f"{scene.name}-{channel}",
                "sensor_token": channel,
                "translation": [1.7, 0.1 * column, 1.5],
                "rotation": _camera_quaternion(2.0 * math.pi * column / len(cameras)),
                "camera_intrinsic": [
                    [0.8 * width + column, 0.0, width / 2.0],
                    [0.0, 0.8 * width + column, height / 2.0],
                    [0.0, 0.0, 1.0],
                ],
            }
        )
    for number in range(num_keyframes):
        time_s = 0.5 * number
        tables["sample"].append(
            {
                "token": sample_token(number),
                "timestamp": start_us + round(time_s * 1e6),
                "scene_token": f"token-{scene.name}",
                "prev": sample_token(number - 1),
                "next": sample_token(number + 1),
            }
        )
        for column, channel in enumerate(cameras):
            name = f"samples/{channel}/{scene.name}-{number:02d}.jpg"
            blocks = rng.integers(0, 256, (5, 8, 3), dtype=np.uint8)
            picture = Image.fromarray(blocks).resize((width, height), Image.Resampling.BILINEAR)
            picture.save(root / name, quality=90)
            more = {"height": height, "width": width}
            add_data(channel, time_s + camera_delay_s(column), number, True, name, **more)
    if not scene.has_lidar:
        return
    for sweep in range(num_sweeps):
        is_key = sweep % 5 == 0
        # As in nuScenes, a sweep belongs to the keyframe that follows it.
        keyframe = -(-sweep // 5)
        name = f"samples/LIDAR_TOP/{scene.name}-{sweep:03d}.pcd.bin"
        if is_key:
            rng.normal(0.0, 10.0, (12, 5)).astype(np.float32).tofile(root / name)
        else:
            name = name.replace("samples", "sweeps")
        add_data("LIDAR_TOP", 0.1 * sweep, keyframe, is_key, name)
