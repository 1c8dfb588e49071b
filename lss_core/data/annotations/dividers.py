"""What parts lanes and roads: the lines of nuScenes' map expansion."""

import numpy as np

from lss_core.data.annotations.map_file import MapRecords
from lss_core.geometry import FloatArray


def divider_lines(records: MapRecords) -> list[FloatArray]:
    """Lane dividers and road dividers, [P, 2] each, P >= 2, in `global`, in metres.

    The line between two lanes, at the edge of one or between the ways of a road, painted or not:
    lines of all segment types.

    Raises:
        ValueError: If the map has no layer of dividers, or a node no place.
        KeyError: If a token leads nowhere.
    """
    if records.lane_divider is None or records.road_divider is None:
        raise ValueError("it has no layers 'lane_divider' and 'road_divider'")
    place = records.places()
    nodes_of = {line.token: line.node_tokens for line in records.line}
    wanted = dict.fromkeys(
        divider.line_token for divider in [*records.lane_divider, *records.road_divider]
    )
    lines = [[place[node] for node in nodes_of[token]] for token in wanted]
    return [np.asarray(line, dtype=np.float64) for line in lines if len(line) >= 2]
