"""shoot-make-world: write a synthetic city as a nuScenes data set."""

from shoot.cli.app import run
from shoot.world.config import VERSION, MakeWorldConfig
from shoot.world.writer import make_world


def _make_world(config: MakeWorldConfig) -> None:
    make_world(config)
    print(f"{config.out}/{VERSION}")


def main() -> None:
    """Entry point of `shoot-make-world`."""
    run(MakeWorldConfig, _make_world, "Write a synthetic city as a nuScenes data set.")
