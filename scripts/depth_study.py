"""How well a camera planner sees depth, and what it would plan if the lidar told it.

python scripts/depth_study.py RUN --split val --out depth.json
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from lss_core.bounds import Count, check_settings
from shoot.cli.app import run
from shoot.prediction.run import open_run
from shoot.studies.depth import DepthStudy, format_depth_study, study_depth
from shoot.training.planning.data import load_split


@dataclass(frozen=True)
class DepthStudyConfig:
    """Ask a camera planner with its own depths, with the lidar's, and without any.

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
    out: str = "depth.json"
    root: str | None = None

    def __post_init__(self) -> None:
        check_settings(self)


def depth_study(config: DepthStudyConfig) -> DepthStudy:
    """Ask, print the tables and save them."""
    trained = open_run(config.run, root=config.root)
    split = load_split(trained.config.data, config.split, trained.templates)
    study = study_depth(trained, split, config.num_samples)
    study.save(Path(config.out))
    print(format_depth_study(study))
    print(f"Report: {config.out}")
    return study


if __name__ == "__main__":
    run(DepthStudyConfig, depth_study, "How well does a camera planner see depth?")
