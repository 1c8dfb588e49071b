"""Labels made with the devkit's own geometry, to hold ours against."""

import cv2
import numpy as np
import shapely
from nuscenes import NuScenes
from nuscenes.map_expansion.map_api import NuScenesMap
from pyquaternion import Quaternion

from lss_core.grid import BevGrid


def box_corners(devkit: NuScenes, token: str, prefix: str) -> list[np.ndarray]:
    """Corners [4, 2] of a sample's boxes of a category, in the ego frame of its lidar time."""
    lidar = devkit.get("sample", token)["data"]["LIDAR_TOP"]
    mounting = devkit.get(
        "calibrated_sensor", devkit.get("sample_data", lidar)["calibrated_sensor_token"]
    )
    corners = []
    for box in devkit.get_sample_data(lidar)[1]:
        box.rotate(Quaternion(mounting["rotation"]))
        box.translate(np.array(mounting["translation"]))
        if box.name.startswith(prefix):
            corners.append(box.bottom_corners()[:2].T)
    return corners


def layers_around(
    devkit: NuScenes, maps: NuScenesMap, token: str, names: list[str], grid: BevGrid
) -> dict[str, list[shapely.Geometry]]:
    """Shapes of map layers around a sample, in its level ego frame; the grid is round the car."""
    lidar = devkit.get("sample_data", devkit.get("sample", token)["data"]["LIDAR_TOP"])
    pose = devkit.get("ego_pose", lidar["ego_pose_token"])
    ahead = Quaternion(pose["rotation"]).rotate(np.array([1.0, 0.0, 0.0]))
    patch = (*pose["translation"][:2], 2.0 * grid.y_max_m, 2.0 * grid.x_max_m)
    angle = float(np.degrees(np.arctan2(ahead[1], ahead[0])))
    return dict(maps.get_map_geom(patch, angle, names))


def holds_centres(shapes: list[shapely.Geometry], grid: BevGrid) -> np.ndarray:
    """[X, Y] whether a cell's centre lies in one of the shapes."""
    x_m, y_m = grid.centres().double().numpy().transpose(2, 0, 1)
    inside = np.zeros(grid.shape, dtype=bool)
    for shape in shapes:
        inside |= shapely.contains_xy(shape, x_m, y_m)
    return inside


def filled_by_opencv(polygons: list[np.ndarray], grid: BevGrid) -> np.ndarray:
    """[X, Y] polygons with corners [., 2] rounded to cells and filled."""
    mask = np.zeros(grid.shape, dtype=np.uint8)
    for points in polygons:
        cells = np.round((points - [grid.x_min_m, grid.y_min_m]) / grid.cell_m)
        cv2.fillPoly(mask, [cells[:, ::-1].astype(np.int32)], 1)
    return mask


def check_labels(
    devkit: NuScenes,
    maps: NuScenesMap,
    token: str,
    grid: BevGrid,
    centre: dict[str, np.ndarray],
    released: dict[str, np.ndarray],
    line_width_m: float,
) -> None:
    """Hold the labels of a sample by both rules against the devkit."""
    for name, prefix in (("car", "vehicle.car"), ("vehicle", "vehicle.")):
        corners = box_corners(devkit, token, prefix)
        expected = holds_centres([shapely.Polygon(points) for points in corners], grid)
        assert (centre[name] == expected).mean() > 0.9999
        np.testing.assert_array_equal(released[name], filled_by_opencv(corners, grid))
    layers = layers_around(
        devkit, maps, token, ["drivable_area", "road_divider", "lane_divider"], grid
    )
    drivable = holds_centres(layers["drivable_area"], grid)
    assert (centre["drivable"] == drivable).mean() > 0.999
    assert 0.05 < drivable.mean() < 0.95
    lines = [*layers["road_divider"], *layers["lane_divider"]]
    strips = [shapely.buffer(line, 0.5 * line_width_m) for line in lines]
    assert (centre["lane_boundary"] == holds_centres(strips, grid)).mean() > 0.999
    # What OpenCV fills is true but for the cells of the border.
    for name in ("drivable", "lane_boundary"):
        around = cv2.dilate(centre[name], np.ones((5, 5), np.uint8))
        assert (released[name] <= around).all()
        assert (cv2.erode(centre[name], np.ones((3, 3), np.uint8)) <= released[name]).all()
