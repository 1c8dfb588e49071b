"""Does a camera planner read the speed of the car from the poses of its cameras?

python scripts/speed_in_poses.py RUN --split val --out pose_speed.json
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from lss_core.bounds import Count, check_settings
from shoot.cli.app import run
from shoot.prediction.run import open_run
from shoot.studies.pose_speed import PoseSpeedStudy, format_pose_speed, study_pose_speed
from shoot.training.planning.data import load_split


@dataclass(frozen=True)
class PoseSpeedConfig:
    """Ask a camera planner with the poses of its cameras as recorded, and as of other speeds.

    Attributes:
        run: Run folder.
        split: Scenes to ask about.
        num_samples: Samples, evenly spread.
        out: Report to write, JSON.
        root: Data root, if not the run's own.
    """

    run: Annotated[str, tyro.conf.Positional]
    split: str = "val"
    num_samples: Count = 400
    out: str = "pose_speed.json"
    root: str | None = None

    def __post_init__(self) -> None:
        check_settings(self)


def speed_in_poses(config: PoseSpeedConfig) -> PoseSpeedStudy:
    """Ask, print the tables and save them."""
    trained = open_run(config.run, root=config.root)
    split = load_split(trained.config.data, config.split, trained.templates)
    study = study_pose_speed(trained, split, config.num_samples)
    study.save(Path(config.out))
    print(format_pose_speed(study))
    print(f"Report: {config.out}")
    return study


if __name__ == "__main__":
    run(PoseSpeedConfig, speed_in_poses, "Does it read the speed from poses?")
