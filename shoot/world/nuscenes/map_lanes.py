"""Lanes in the layers of a map: outlines, ends, middle lines, what follows what, stop lines."""

from collections.abc import Callable
from itertools import pairwise

import numpy as np
import shapely
import shapely.ops

from lss_core.data.writing.table_rows import Row
from shoot.world.looks.paint import polygons_of
from shoot.world.nuscenes.map_drawer import MapDrawer
from shoot.world.nuscenes.tables import rounded
from shoot.world.town.town import FloatArray, Lane


def add_lane(draw: MapDrawer, lane: Lane, segment_at: Callable[[FloatArray], str]) -> None:
    """Append a lane, or a path across an intersection, with its road block and stop line.

    Args:
        draw: Takes them.
        lane: Which.
        segment_at: Token of the road segment at a point [2] of the town.
    """
    band = shapely.LineString(lane.centreline_m).buffer(lane.width_m / 2, cap_style="flat")
    band = max(polygons_of(shapely.simplify(band, 0.03)), key=lambda part: part.area)
    layer = "lane_connector" if lane.turn is not None else "lane"
    lane_token = draw.token("lane", lane.lane_id)
    row: Row = {"token": lane_token, "polygon_token": draw.polygon(band)}
    start, end = (_edge(lane, at) for at in (0, -1))
    if layer == "lane":
        row |= {
            "lane_type": "CAR",
            "from_edge_line_token": draw.line(start),
            "to_edge_line_token": draw.line(end),
            "left_lane_divider_segments": [],
            "right_lane_divider_segments": [],
        }
        draw.add("road_block", {
            "token": draw.token("road_block", lane.lane_id),
            "polygon_token": row["polygon_token"],
            "from_edge_line_token": row["from_edge_line_token"],
            "to_edge_line_token": row["to_edge_line_token"],
            "road_segment_token": segment_at(lane.centreline_m[len(lane.centreline_m) // 2]),
        })  # fmt: skip
    draw.add(layer, row)
    draw.layers["arcline_path_3"][lane_token] = arcline_path(lane.centreline_m + draw.origin_m)
    links = draw.layers["connectivity"].setdefault(lane_token, {"incoming": [], "outgoing": []})
    for successor in lane.successors:
        next_token = draw.token("lane", successor)
        links["outgoing"].append(next_token)
        onward = draw.layers["connectivity"].setdefault(
            next_token, {"incoming": [], "outgoing": []}
        )
        onward["incoming"].append(lane_token)
    if lane.stop_at_m is not None and lane.turn is None:
        _add_stop_line(draw, lane)


def _add_stop_line(draw: MapDrawer, lane: Lane) -> None:
    line = shapely.LineString(lane.centreline_m)
    at_m = float(lane.stop_at_m or 0.0)
    piece = shapely.ops.substring(line, max(at_m - 0.6, 0.0), min(at_m + 0.6, line.length))
    if piece.geom_type != "LineString":
        return
    kind = "TRAFFIC_LIGHT" if lane.signal is not None else "STOP_SIGN"
    lights = [] if lane.signal is None else [draw.token("traffic_light", lane.signal)]
    draw.add("stop_line", {
        "token": draw.token("stop_line", lane.lane_id),
        "polygon_token": draw.polygon(piece.buffer(lane.width_m / 2, cap_style="flat")),
        "stop_line_type": kind,
        "ped_crossing_tokens": [draw.token("ped_crossing", i) for i, _ in lane.crosswalks],
        "traffic_light_tokens": lights,
        "road_block_token": draw.token("road_block", lane.lane_id),
    })  # fmt: skip


def _edge(lane: Lane, at: int) -> FloatArray:
    points = lane.centreline_m
    step = points[1] - points[0] if at == 0 else points[-1] - points[-2]
    left = np.array([-step[1], step[0]]) / max(float(np.hypot(*step)), 1e-9) * lane.width_m / 2
    return np.stack([points[at] + left, points[at] - left])


def arcline_path(points_m: FloatArray) -> list[Row]:
    """A polyline as the devkit's arc-line path: straight pieces that stay within 5 cm of it."""
    line = np.asarray(shapely.LineString(points_m).simplify(0.05).coords)
    pieces = []
    for start, end in pairwise(line):
        step = end - start
        heading = float(np.arctan2(step[1], step[0]))
        pieces.append({
            "start_pose": [*rounded(start, 4), round(heading, 8)],
            "end_pose": [*rounded(end, 4), round(heading, 8)],
            "shape": "LSL",
            "radius": 1000.0,
            "segment_length": [0.0, round(float(np.hypot(*step)), 4), 0.0],
        })  # fmt: skip
    return pieces
