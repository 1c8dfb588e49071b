"""Geometry appended to the layers of a map, under tokens that depend on the town alone."""

from typing import Any

import numpy as np
import shapely

from lss_core.data.writing.table_rows import Row, token
from shoot.world.town.town import FloatArray

LAYERS = (
    "polygon", "line", "node", "drivable_area", "road_segment", "road_block", "lane",
    "ped_crossing", "walkway", "stop_line", "carpark_area", "road_divider",
    "lane_divider", "traffic_light", "lane_connector",
)  # fmt: skip
MapLayers = dict[str, Any]


def empty_layers() -> MapLayers:
    """A map without anything in it."""
    layers: MapLayers = {name: [] for name in LAYERS}
    layers["arcline_path_3"] = {}
    layers["connectivity"] = {}
    return layers


class MapDrawer:
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
        """Append a row to a layer; its token."""
        self.layers[layer].append(row)
        return str(row["token"])

    def _nodes(self, points_m: FloatArray) -> list[str]:
        places = np.round(np.asarray(points_m, float)[:, :2] + self.origin_m, 3).tolist()
        rows = [{"token": self.token("node"), "x": x, "y": y} for x, y in places]
        self.layers["node"] += rows
        return [row["token"] for row in rows]

    def polygon(self, area: shapely.Polygon) -> str:
        """Append an outline with holes, in metres in the town's frame; its token."""
        rings = [np.asarray(ring.coords)[:-1] for ring in (area.exterior, *area.interiors)]
        return self.add("polygon", {
            "token": self.token("polygon"),
            "exterior_node_tokens": self._nodes(rings[0]),
            "holes": [{"node_tokens": self._nodes(ring)} for ring in rings[1:]],
        })  # fmt: skip

    def line(self, points_m: FloatArray) -> str:
        """Append a line through points [P, 2 or more], in metres in the town's frame; its token."""
        nodes = self._nodes(points_m)
        return self.add("line", {"token": self.token("line"), "node_tokens": nodes})

    def line_nodes(self, line_token: str) -> list[str]:
        """Tokens of the nodes of the line that was appended last."""
        last: Row = self.layers["line"][-1]
        if last["token"] != line_token:
            raise AssertionError("only the newest line")
        return list(last["node_tokens"])
