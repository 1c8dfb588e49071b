"""shoot-train: train a planner with a preset and overrides."""

import tyro

from shoot.cli.app import run
from shoot.training.planning.config import PRESETS, TrainConfig
from shoot.training.planning.task import train


def _fit(config: TrainConfig) -> None:
    folder = train(config)
    print(f"Trained {config.optim.steps} steps; the run is in {folder}.")


def main() -> None:
    """Entry point."""
    run(
        tyro.extras.subcommand_type_from_defaults(  # one subcommand a preset
            {name: config for name, (_, config) in PRESETS.items()},
            {name: text for name, (text, _) in PRESETS.items()},
            prefix_names=False,
        ),
        _fit,
        "Train a planner: a preset, then overrides.",
    )
