"""Towns as nuScenes map expansion layers (version 1.3)."""

from collections.abc import Callable, Sequence

import numpy as np
import shapely

from lss_core.data.writing.table_rows import Row
from shoot.world.looks.paint import polygons_of
from shoot.world.nuscenes.map_drawer import LAYERS, MapDrawer, MapLayers, empty_layers
from shoot.world.nuscenes.map_lanes import add_lane
from shoot.world.nuscenes.tables import rounded
from shoot.world.nuscenes.tiling import TILE_M, Location
from shoot.world.town.town import FloatArray, Town


def town_layers(town: Town, name: str, origin_m: FloatArray) -> MapLayers:
    """Map layers of a town with origin at `origin_m` ([2], `global`); `name` makes its tokens."""
    draw = MapDrawer(name, origin_m)
    area = draw.token("drivable_area", 0)
    roads = [draw.polygon(part) for part in polygons_of(shapely.simplify(town.road, 0.03))]
    draw.add("drivable_area", {"token": area, "polygon_tokens": roads})
    for number, crossing in enumerate(town.intersections):
        draw.add("road_segment", {
            "token": draw.token("road_segment", number),
            "polygon_token": draw.polygon(shapely.Polygon(crossing.outline_m)),
            "is_intersection": True,
            "drivable_area_token": area,
        })  # fmt: skip
    junctions = shapely.union_all([shapely.Polygon(c.outline_m) for c in town.intersections])
    streets = list(polygons_of(shapely.simplify(shapely.difference(town.road, junctions), 0.03)))
    for number, street in enumerate(streets):
        draw.add("road_segment", {
            "token": draw.token("road_segment", len(town.intersections) + number),
            "polygon_token": draw.polygon(street),
            "is_intersection": False,
            "drivable_area_token": area,
        })  # fmt: skip

    segments = shapely.STRtree([shapely.Polygon(c.outline_m) for c in town.intersections] + streets)

    def segment_at(point_m: FloatArray) -> str:
        return draw.token("road_segment", int(segments.nearest(shapely.Point(*point_m[:2]))))

    for number, crosswalk in enumerate(town.crosswalks):
        draw.add("ped_crossing", {
            "token": draw.token("ped_crossing", number),
            "polygon_token": draw.polygon(shapely.Polygon(crosswalk.outline_m)),
            "road_segment_token": segment_at(np.mean(crosswalk.path_m, axis=0)),
        })  # fmt: skip
    for layer, surface in (("walkway", town.pavement), ("carpark_area", town.parking)):
        for part in polygons_of(shapely.simplify(surface, 0.03)):
            row: Row = {"token": draw.token(layer), "polygon_token": draw.polygon(part)}
            if layer == "carpark_area":
                row |= {"orientation": 0.0, "road_block_token": ""}
            draw.add(layer, row)
    _add_lines(draw, town, segment_at)
    _add_lights(draw, town)
    for lane in town.lanes:
        add_lane(draw, lane, segment_at)
    return draw.layers


def _add_lines(draw: MapDrawer, town: Town, segment_at: Callable[[FloatArray], str]) -> None:
    for line in town.lines:
        points = np.asarray(line.points_m, float)
        if line.kind == "centre":
            row = {"token": draw.token("road_divider"), "line_token": draw.line(points)}
            draw.add(
                "road_divider", row | {"road_segment_token": segment_at(points[len(points) // 2])}
            )
        elif line.kind in ("lane", "edge"):
            line_token = draw.line(points)
            kind = "SINGLE_SOLID_WHITE" if line.kind == "edge" else "DOUBLE_DASHED_WHITE"
            segments = [
                {"node_token": node, "segment_type": kind} for node in draw.line_nodes(line_token)
            ]
            row = {"token": draw.token("lane_divider"), "line_token": line_token}
            draw.add("lane_divider", row | {"lane_divider_segments": segments})


def _add_lights(draw: MapDrawer, town: Town) -> None:
    for number, lights in enumerate(town.signals):
        head = lights.heads_m[0]
        ahead = np.array([np.cos(lights.facing_rad), np.sin(lights.facing_rad)])
        left = np.array([-ahead[1], ahead[0]])
        x, y = rounded(head[:2] + draw.origin_m, 3)
        items = [
            {
                "color": color,
                "shape": "CIRCLE",
                "rel_pos": _offset((1 - i) * 0.46),
                "to_road_block_tokens": [],
            }
            for i, color in enumerate(("RED", "YELLOW", "GREEN"))
        ]
        draw.add("traffic_light", {
            "token": draw.token("traffic_light", number),
            "line_token": draw.line(np.stack([head[:2] - 0.5 * left, head[:2] + 0.5 * left])),
            "traffic_light_type": "VERTICAL",
            "from_road_block_token": "",
            "items": items,
            "pose": {"tx": x, "ty": y, "tz": round(float(head[2]), 3), "rx": 0.0, "ry": 0.0,
                     "rz": round(float(lights.facing_rad), 6)},
        })  # fmt: skip


def _offset(up_m: float) -> dict[str, float]:
    return {"tx": 0.0, "ty": 0.0, "tz": up_m, "rx": 0.0, "ry": 0.0, "rz": 0.0}


def merge_layers(parts: Sequence[MapLayers], canvas_m: tuple[float, float]) -> MapLayers:
    """Put the towns of one map together."""
    merged = empty_layers()
    for part in parts:
        for name in LAYERS:
            merged[name] += part[name]
        for name in ("arcline_path_3", "connectivity"):
            merged[name] |= part[name]
    return {"version": "1.3", "canvas_edge": list(canvas_m), **merged}


def canvas_of(location: Location, columns: int, rows: int) -> tuple[float, float]:
    """(width, height) of a map: the real one's, or larger if the towns need it."""
    return max(location.canvas_m[0], columns * TILE_M), max(location.canvas_m[1], rows * TILE_M)
