"""Towns as nuScenes map expansion layers (version 1.3) and as drivable-surface masks."""

import zlib
from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import shapely
import shapely.ops
from numpy.typing import NDArray

from lss_core.data.writing.table_rows import Row, token
from lss_core.files import write_atomically
from shoot.world.looks.paint import polygons_of
from shoot.world.nuscenes.tables import rounded
from shoot.world.nuscenes.tiling import TILE_M, Location
from shoot.world.town.town import FloatArray, Lane, Town

MASK_CELL_M = 0.1
_LAYERS = (
    "polygon", "line", "node", "drivable_area", "road_segment", "road_block", "lane",
    "ped_crossing", "walkway", "stop_line", "carpark_area", "road_divider",
    "lane_divider", "traffic_light", "lane_connector",
)  # fmt: skip
MapLayers = dict[str, Any]


def empty_layers() -> MapLayers:
    """A map without anything in it."""
    layers: MapLayers = {name: [] for name in _LAYERS}
    layers["arcline_path_3"] = {}
    layers["connectivity"] = {}
    return layers


class _Drawer:
    """Appends geometry to map layers under tokens that depend on the town alone."""

    def __init__(self, name: str, origin_m: FloatArray) -> None:
        self.layers = empty_layers()
        self._name = name
        self.origin_m = origin_m
        self._count = 0

    def token(self, kind: str, number: int | None = None) -> str:
        """Token of the town's `number`-th thing of a kind; of a new one if there is no number."""
        if number is None:
            self._count += 1
            number = self._count
        return token("map", self._name, kind, number)

    def add(self, layer: str, row: Row) -> str:
        self.layers[layer].append(row)
        return str(row["token"])

    def _nodes(self, points_m: FloatArray) -> list[str]:
        places = np.round(np.asarray(points_m, float)[:, :2] + self.origin_m, 3).tolist()
        rows = [{"token": self.token("node"), "x": x, "y": y} for x, y in places]
        self.layers["node"] += rows
        return [row["token"] for row in rows]

    def polygon(self, area: shapely.Polygon) -> str:
        rings = [np.asarray(ring.coords)[:-1] for ring in (area.exterior, *area.interiors)]
        return self.add("polygon", {
            "token": self.token("polygon"),
            "exterior_node_tokens": self._nodes(rings[0]),
            "holes": [{"node_tokens": self._nodes(ring)} for ring in rings[1:]],
        })  # fmt: skip

    def line(self, points_m: FloatArray) -> str:
        nodes = self._nodes(points_m)
        return self.add("line", {"token": self.token("line"), "node_tokens": nodes})

    def line_nodes(self, line_token: str) -> list[str]:
        last: Row = self.layers["line"][-1]
        if last["token"] != line_token:
            raise AssertionError("only the newest line")
        return list(last["node_tokens"])


def town_layers(town: Town, name: str, origin_m: FloatArray) -> MapLayers:
    """Map layers of a town with origin at `origin_m` ([2], `global`); `name` makes its tokens."""
    draw = _Drawer(name, origin_m)
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
        _add_lane(draw, lane, segment_at)
    return draw.layers


def _add_lines(draw: _Drawer, town: Town, segment_at: Callable[[FloatArray], str]) -> None:
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


def _add_lights(draw: _Drawer, town: Town) -> None:
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


def _add_lane(draw: _Drawer, lane: Lane, segment_at: Callable[[FloatArray], str]) -> None:
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


def _add_stop_line(draw: _Drawer, lane: Lane) -> None:
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


def merge_layers(parts: Sequence[MapLayers], canvas_m: tuple[float, float]) -> MapLayers:
    """Put the towns of one map together."""
    merged = empty_layers()
    for part in parts:
        for name in _LAYERS:
            merged[name] += part[name]
        for name in ("arcline_path_3", "connectivity"):
            merged[name] |= part[name]
    return {"version": "1.3", "canvas_edge": list(canvas_m), **merged}


def canvas_of(location: Location, columns: int, rows: int) -> tuple[float, float]:
    """(width, height) of a map: the real one's, or larger if the towns need it."""
    return max(location.canvas_m[0], columns * TILE_M), max(location.canvas_m[1], rows * TILE_M)


def town_mask(town: Town) -> NDArray[np.uint8]:
    """Where a town is road or pavement: 255, else 0; [S, S], one tile, row 0 at its lower edge."""
    side = round(TILE_M / MASK_CELL_M)
    mask = np.zeros((side, side), np.uint8)
    for surface in (town.pavement, town.road):
        for part in polygons_of(surface):
            rings = [
                np.round(np.asarray(ring.coords) / MASK_CELL_M * 16 - 8).astype(np.int32)
                for ring in (part.exterior, *part.interiors)
            ]
            # All rings at once: inside then means in an odd number of them, and holes stay free.
            cv2.fillPoly(mask, rings, 255, cv2.LINE_8, 4)
    return mask


def write_mask(path: Path, tiles: dict[tuple[int, int], Path], columns: int, rows: int) -> None:
    """Join the masks of towns (PNG files by (column, row)) into one PNG, north up.

    The file is written band by band with two bits a pixel, which readers expand to 0 and 255: a map
    of a hundred towns has a thousand million pixels and would not fit into memory.
    """
    side = round(TILE_M / MASK_CELL_M)

    def bands() -> Iterator[bytes]:
        for row in reversed(range(rows)):
            band = np.zeros((side, columns * side), np.uint8)
            for column in range(columns):
                if (column, row) in tiles:
                    tile = cv2.imread(str(tiles[column, row]), cv2.IMREAD_GRAYSCALE)
                    band[:, column * side : (column + 1) * side] = tile[::-1] >= 128
            quarters = (band * np.uint8(3)).reshape(side, -1, 4)
            packed = (
                quarters[..., 0] << 6
                | quarters[..., 1] << 4
                | quarters[..., 2] << 2
                | quarters[..., 3]
            )
            # Each line starts with its filter: 0, none.
            yield np.pad(packed, ((0, 0), (1, 0))).astype(np.uint8).tobytes()

    _write_png(path, columns * side, rows * side, bands())


def _write_png(path: Path, width: int, height: int, bands: Iterator[bytes]) -> None:
    """Write a grey PNG of two bits a pixel from packed, filtered lines."""

    def piece(kind: bytes, content: bytes) -> bytes:
        check = zlib.crc32(kind + content)
        return len(content).to_bytes(4, "big") + kind + content + check.to_bytes(4, "big")

    squeeze = zlib.compressobj(6)
    with write_atomically(path) as stream:
        stream.write(b"\x89PNG\r\n\x1a\n")
        size = width.to_bytes(4, "big") + height.to_bytes(4, "big")
        stream.write(piece(b"IHDR", size + bytes([2, 0, 0, 0, 0])))
        for band in bands:
            content = squeeze.compress(band)
            if content:
                stream.write(piece(b"IDAT", content))
        stream.write(piece(b"IDAT", squeeze.flush()))
        stream.write(piece(b"IEND", b""))
