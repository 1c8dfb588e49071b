"""shoot-train: train a planner or a segmentation with a preset and overrides."""

from collections.abc import Callable

import tyro

from shoot.cli.app import run
from shoot.training.planning.config import PRESETS as PLANNING_PRESETS
from shoot.training.planning.config import TrainConfig
from shoot.training.planning.task import train
from shoot.training.segmentation.config import PRESETS as SEGMENTATION_PRESETS
from shoot.training.segmentation.config import SegmentConfig
from shoot.training.segmentation.task import segment

_PRESETS: dict[str, tuple[str, TrainConfig | SegmentConfig]] = {
    **PLANNING_PRESETS,
    **SEGMENTATION_PRESETS,
}


def _fit(config: TrainConfig | SegmentConfig) -> None:
    folder = segment(config) if isinstance(config, SegmentConfig) else train(config)
    print(f"Trained {config.optim.steps} steps; the run is in {folder}.")


def main() -> None:
    """Entry point."""
    by_preset: Callable[..., TrainConfig | SegmentConfig] = (
        tyro.extras.subcommand_type_from_defaults(
            {name: config for name, (_, config) in _PRESETS.items()},
            {name: text for name, (text, _) in _PRESETS.items()},
            prefix_names=False,
        )
    )
    run(by_preset, _fit, "Train a planner or a segmentation: a preset, then overrides.")
