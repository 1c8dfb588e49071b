"""The file of nuScenes' map expansion: where it is, what is read of it, and what is wrong."""

import math
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import msgspec
import shapely

from lss_core.data.tables.file_names import is_plain
from lss_core.data.tables.reading import decode_json
from lss_core.errors import DataError

_DAMAGE = (
    ValueError,
    OverflowError,
    RecursionError,
    msgspec.ValidationError,  # of late a ValueError
    shapely.errors.ShapelyError,
)
_ANEW = "unpack the nuScenes map expansion (nuScenes-map-expansion-v1.3.zip)"

Made = TypeVar("Made")


class _Node(msgspec.Struct, gc=False):
    token: str
    x: float
    y: float


class Hole(msgspec.Struct, gc=False):
    """A ring that is not of its polygon."""

    node_tokens: list[str]


class PolygonRecord(msgspec.Struct, gc=False):
    """An outline and holes in it."""

    token: str
    exterior_node_tokens: list[str]
    holes: list[Hole]


class LineRecord(msgspec.Struct, gc=False):
    """Nodes in their order."""

    token: str
    node_tokens: list[str]


class _Area(msgspec.Struct, gc=False):
    polygon_tokens: list[str]


class _Divider(msgspec.Struct, gc=False):
    line_token: str


class MapRecords(msgspec.Struct, gc=False):
    """The layers that are used; a map may lack those of lines."""

    node: list[_Node]
    polygon: list[PolygonRecord]
    drivable_area: list[_Area]
    line: list[LineRecord] = []
    road_divider: list[_Divider] | None = None
    lane_divider: list[_Divider] | None = None

    def places(self) -> dict[str, tuple[float, float]]:
        """Node -> its place in `global`, in metres.

        Raises:
            ValueError: If a node has none.
        """
        place = {node.token: (node.x, node.y) for node in self.node}
        lost = next((token for token, xy in place.items() if not all(map(math.isfinite, xy))), None)
        if lost is not None:
            raise ValueError(f"node '{lost}' has no place")
        return place


def map_path(root: Path, location: str) -> Path:
    """Where a data set has the map expansion of a location.

    Raises:
        DataError: If the location is no name of a file.
    """
    if not is_plain(location):
        raise DataError(
            f"The location '{location}' of the log table cannot be the name of a map's file; name "
            "it otherwise there."
        )
    return root / "maps" / "expansion" / f"{location}.json"


def has_map(root: Path, location: str) -> bool:
    """Whether a data set has the map expansion of a location."""
    return is_plain(location) and map_path(root, location).is_file()


def read_map(root: Path, location: str, make: Callable[[MapRecords], Made]) -> Made:
    """What is made of the map of a location, as `boston-seaport`.

    Args:
        root: Of the data set, holds `maps`.
        location: As the `log` table names it.
        make: Makes it; what this cannot use is damage of the file.

    Raises:
        DataError: If the map is missing or damaged, or the location is no name of a file.
    """
    path = map_path(root, location)
    try:
        return make(decode_json(path.read_bytes(), MapRecords))
    except FileNotFoundError as error:
        raise DataError(f"The map '{path}' is missing; {_ANEW} into '{root / 'maps'}'.") from error
    except OSError as error:
        raise DataError(f"The map '{path}' cannot be read: {error}.") from error
    except KeyError as error:
        raise DataError(
            f"The map '{path}' is damaged (no record {error}); {_ANEW} anew."
        ) from error
    except _DAMAGE as error:
        raise DataError(f"The map '{path}' is damaged ({error}); {_ANEW} anew.") from error
