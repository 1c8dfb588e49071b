"""The jobs that make a world: one for each town, with its scenes."""

from collections.abc import Iterator
from dataclasses import dataclass

from lss_core.data.splits import official_scenes
from shoot.world.config import VERSION, MakeWorldConfig
from shoot.world.nuscenes.capture import SceneOrder
from shoot.world.nuscenes.tiling import Split, Tile, tile_of


@dataclass(frozen=True)
class TownOrder:
    """One job: a town and its scenes."""

    split: Split
    index: int
    seed: int
    tile: Tile
    scenes: tuple[SceneOrder, ...]

    @property
    def name(self) -> str:
        """Of its files among the parts."""
        return f"town-{self.split}-{self.index:04d}"


def town_orders(config: MakeWorldConfig) -> Iterator[TownOrder]:
    """The towns of a world, those of `train` first."""
    counts: tuple[tuple[Split, int, int], ...] = (
        ("train", config.train_scenes, config.scenes_per_town),
        ("val", config.val_scenes, 1),
    )
    for split, num_scenes, per_town in counts:
        names = official_scenes(VERSION, split)
        for first in range(0, num_scenes, per_town):
            town = first // per_town
            tile = tile_of(split, town)
            scenes = tuple(
                SceneOrder(
                    names[index], split, index, town, config.seed,
                    config.duration_s, config.keyframe_s, config.tail_s, config.rig,
                    config.image_scale, config.azimuths(), config.sweeps, tile,
                )
                for index in range(first, min(first + per_town, num_scenes))
            )  # fmt: skip
            yield TownOrder(split, town, config.seed, tile, scenes)
