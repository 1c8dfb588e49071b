"""One scene as rows of the nuScenes tables."""

from dataclasses import dataclass, field

import numpy as np

from lss_core.data.writing.table_rows import Row, chain, token
from shoot.world.sensing.rig import Rig, quaternion_wxyz
from shoot.world.town.town import FloatArray

CATEGORIES = {
    "car": ("vehicle.car", "Cars that move or could."),
    "truck": ("vehicle.truck", "Lorries with a cargo box."),
    "pedestrian": ("human.pedestrian.adult", "People on foot."),
}
_ATTRIBUTES = {
    "vehicle.moving": "Vehicle is moving.",
    "vehicle.stopped": "Vehicle stands in traffic.",
    "vehicle.parked": "Vehicle is parked.",
    "pedestrian.moving": "The person walks.",
    "pedestrian.standing": "The person stands.",
}
_VISIBILITIES = (("1", 0, 40), ("2", 40, 60), ("3", 60, 80), ("4", 80, 100))


def fixed_tables(channels: tuple[str, ...]) -> dict[str, list[Row]]:
    """Tables that are the same in every data set: categories, attributes, visibilities, sensors."""
    return {
        "category": [
            {
                "token": token("category", name),
                "name": name,
                "description": text,
                "index": index + 1,
            }
            for index, (name, text) in enumerate(CATEGORIES.values())
        ],
        "attribute": [
            {"token": token("attribute", name), "name": name, "description": text}
            for name, text in _ATTRIBUTES.items()
        ],
        "visibility": [
            {
                "token": number,
                "level": f"v{low}-{high}",
                "description": f"visibility of whole object is between {low} and {high}%",
            }
            for number, low, high in _VISIBILITIES
        ],
        "sensor": [
            {
                "token": token("sensor", channel),
                "channel": channel,
                "modality": "lidar" if channel.startswith("LIDAR") else "camera",
            }
            for channel in channels
        ],
    }


def visibility_token(share: float) -> str:
    """Token of nuScenes' four classes of how much of an object is visible (0 to 1)."""
    return "1" if share < 0.4 else "2" if share < 0.6 else "3" if share < 0.8 else "4"


def rounded(values: FloatArray | list[float], digits: int) -> list[float]:
    """Floats short enough to read, long enough to lose nothing that matters."""
    # Adding 0 turns -0.0 into 0.0.
    return [round(float(value), digits) + 0.0 for value in values]


def calibration_rows(rig: Rig, scene_name: str, seed: int) -> dict[str, Row]:
    """`calibrated_sensor` rows by channel."""
    rows: dict[str, Row] = {}
    mounts = [(c.channel, c.ego_from_camera, c.pixel_from_camera.tolist()) for c in rig.cameras]
    mounts.append(("LIDAR_TOP", rig.ego_from_lidar, []))
    for channel, pose, intrinsic in mounts:
        rows[channel] = {
            "token": token(seed, scene_name, "calibrated_sensor", channel),
            "sensor_token": token("sensor", channel),
            "translation": rounded(pose[:3, 3], 6),
            "rotation": rounded(quaternion_wxyz(pose[:3, :3]), 12),
            "camera_intrinsic": [rounded(line, 6) for line in intrinsic],
        }
    return rows


def pose_row(row_token: str, stamp_us: int, xy_m: FloatArray, yaw_rad: float) -> Row:
    """`ego_pose` row; the city is flat."""
    return {
        "token": row_token,
        "timestamp": stamp_us,
        "rotation": rounded([np.cos(yaw_rad / 2), 0.0, 0.0, np.sin(yaw_rad / 2)], 12),
        "translation": [*rounded(xy_m, 6), 0.0],
    }


@dataclass
class AnnotationBook:
    """Collects the boxes of one scene, instance by instance, in the order of time."""

    seed: int
    scene_name: str
    _boxes: dict[int, list[Row]] = field(default_factory=dict)
    _kinds: dict[int, str] = field(default_factory=dict)

    def add(
        self,
        sample_token: str,
        object_id: int,
        kind: str,
        centre_m: FloatArray,
        yaw_rad: float,
        size_m: FloatArray,
        attribute: str,
        visible_share: float,
        num_lidar_points: int,
    ) -> None:
        """Note one box; `centre_m` [3] in `global`, `size_m` length, width, height."""
        length, width, height = rounded(size_m, 4)
        row_token = token(self.seed, self.scene_name, "annotation", object_id, sample_token)
        self._kinds[object_id] = kind
        self._boxes.setdefault(object_id, []).append({
            "token": row_token,
            "sample_token": sample_token,
            "instance_token": token(self.seed, self.scene_name, "instance", object_id),
            "visibility_token": visibility_token(visible_share),
            "attribute_tokens": [token("attribute", attribute)],
            "translation": rounded(centre_m, 4),
            "size": [width, length, height],
            "rotation": rounded([np.cos(yaw_rad / 2), 0.0, 0.0, np.sin(yaw_rad / 2)], 12),
            "prev": "",
            "next": "",
            "num_lidar_pts": num_lidar_points,
            "num_radar_pts": 0,
        })  # fmt: skip

    def rows(self) -> tuple[list[Row], list[Row]]:
        """Rows of `instance` and of `sample_annotation`."""
        instances: list[Row] = []
        annotations: list[Row] = []
        for object_id in sorted(self._boxes):
            boxes = self._boxes[object_id]
            chain(boxes)
            annotations += boxes
            category = CATEGORIES[self._kinds[object_id]][0]
            instances.append({
                "token": boxes[0]["instance_token"],
                "category_token": token("category", category),
                "nbr_annotations": len(boxes),
                "first_annotation_token": boxes[0]["token"],
                "last_annotation_token": boxes[-1]["token"],
            })  # fmt: skip
        return instances, annotations
