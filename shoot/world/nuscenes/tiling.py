"""Where each town lies on nuScenes' four maps, and the few fixed names the devkit insists on."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from lss_core.data.writing.table_rows import token
from shoot.world.town.town import FloatArray

Split = Literal["train", "val"]

TILE_M = 396.0
_COLUMNS_TRAIN, _COLUMNS = 3, 4


@dataclass(frozen=True)
class Location:
    """One of the four maps the devkit knows.

    Attributes:
        name: nuScenes' name.
        mask_name: Name of its mask file; the devkit's map renderers look for exactly this one.
        canvas_m: (width, height) of the real map; ours grows beyond it if the towns do.
    """

    name: str
    mask_name: str
    canvas_m: tuple[float, float]


LOCATIONS = (
    Location("singapore-onenorth", "53992ee3023e5494b90c316c183be829", (1585.6, 2025.0)),
    Location("singapore-hollandvillage", "37819e65e09e5547b8a3ceaefba56bb2", (2808.3, 2922.9)),
    Location("singapore-queenstown", "93406b464a165eaba6d9de76ca09f5da", (3228.6, 3687.1)),
    Location("boston-seaport", "36092f0b03a857c6a3403e25b4b7aab3", (2979.5, 2118.1)),
)


@dataclass(frozen=True)
class Tile:
    """A town's place.

    Attributes:
        location: Index into `LOCATIONS`.
        column, row: Counted from the map's lower left corner, `TILE_M` each.
    """

    location: int
    column: int
    row: int

    @property
    def origin_m(self) -> FloatArray:
        """[2] the town's origin in `global`."""
        return np.array([self.column, self.row]) * TILE_M


def tile_of(split: Split, town_index: int) -> Tile:
    """Place a town so that it depends on nothing but its split and number.

    Towns go round the four maps; on each, training fills three columns from below, validation the
    fourth.
    """
    turn, location = divmod(town_index, len(LOCATIONS))
    if split == "val":
        return Tile(location, _COLUMNS - 1, turn)
    row, column = divmod(turn, _COLUMNS_TRAIN)
    return Tile(location, column, row)


def seed_of(*parts: object) -> int:
    """A seed (32 bits) that depends on `parts` alone."""
    return int(token("seed", *parts)[:8], 16)
