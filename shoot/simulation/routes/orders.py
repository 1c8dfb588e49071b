"""Which routes are driven: two in each town, in towns that no data set has."""

from collections.abc import Iterator
from dataclasses import dataclass

from shoot.world.nuscenes.tiling import seed_of

ROUTES_PER_TOWN = 2
# A split of its own: the towns of data sets are grown from other names.
_SPLIT = "route"


@dataclass(frozen=True)
class RouteOrder:
    """One route.

    Attributes:
        index: Its number.
        town: Number of its town.
        town_seed: What the town is grown from.
        seed: Of traffic, light and weather, see `Simulator`.
    """

    index: int
    town: int
    town_seed: int
    seed: int


def route_orders(num: int, seed: int) -> Iterator[RouteOrder]:
    """The first `num` routes of a seed; more of them begin with the same."""
    for index in range(num):
        town = index // ROUTES_PER_TOWN
        yield RouteOrder(
            index,
            town,
            town_seed=seed_of(seed, _SPLIT, "town", town),
            seed=seed_of(seed, _SPLIT, "scene", index),
        )
