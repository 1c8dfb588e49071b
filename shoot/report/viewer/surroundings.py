"""What stands and moves around the car as a page draws it: edges of the road, annotated boxes."""

from pathlib import Path

import numpy as np
import shapely

from lss_core.config import DataConfig
from lss_core.data.annotations.boxes import has_annotations, read_boxes
from lss_core.data.annotations.drivable import load_drivable_area
from lss_core.data.annotations.map_file import has_map
from lss_core.geometry import FloatArray, yaw_of
from shoot.evaluation.box_moments import find_moments
from shoot.footprint import turn
from shoot.training.planning.data import LabelledSplit

# A line is drawn to about a pixel.
_SMOOTH_M = 0.1
# Corners in halves of length and width, counter-clockwise.
_CORNERS = np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]])


def road_edges(data: DataConfig, split: LabelledSplit, reach_m: float) -> list[FloatArray]:
    """Lines [P, 2] round the drivable area of one scene, in `global`; none without a map.

    Args:
        data: Where the map is.
        split: Samples of one scene.
        reach_m: How far from them a line may be and still be seen.

    Raises:
        DataError: If the map is damaged.
    """
    index, root = split.index, Path(data.root)
    location = str(index.scene_location[split.scene_rows[0]])
    if not has_map(root, location):
        return []
    xy_m = index.global_from_ego[split.rows][:, :2, 3]
    bounds_m = (*(xy_m.min(axis=0) - reach_m), *(xy_m.max(axis=0) + reach_m))
    polygons = load_drivable_area(root, location).polygons
    near = [polygon for polygon in polygons if polygon.intersects(shapely.box(*bounds_m))]
    parts = shapely.clip_by_rect(np.asarray(near, dtype=object), *bounds_m)
    edges = shapely.boundary(shapely.union_all(parts)).simplify(_SMOOTH_M)
    return [shapely.get_coordinates(line) for line in shapely.get_parts(edges)]


def boxes_around(data: DataConfig, split: LabelledSplit) -> list[list[FloatArray]]:
    """Corners [4, 2] of the annotated vehicles and people of each sample, in its `ego`.

    Raises:
        DataError: If a table is damaged.
    """
    index = split.index
    around: list[list[FloatArray]] = [[] for _ in split.rows]
    folder = Path(data.root) / data.version
    if not has_annotations(folder):
        return around
    pose = index.global_from_ego[split.rows]
    moments = find_moments(
        read_boxes(folder, index, np.unique(split.scene_rows)),
        split.scene_rows,
        index.time_s[split.rows],
        pose[:, :2, 3],
        yaw_of(pose),
        np.zeros(1),
    )
    corners_m = turn(
        0.5 * moments.size_m[:, None].astype(np.float64) * _CORNERS, moments.yaw_rad[:, None]
    )
    corners_m = corners_m + moments.xy_m[:, None]
    for sample, corners in zip(moments.sample.tolist(), corners_m, strict=True):
        around[sample].append(corners)
    return around
