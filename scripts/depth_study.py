"""How well a camera planner sees depth, and what it would plan if the lidar told it.

python scripts/depth_study.py RUN --split val --out depth.json
"""

from asked_run import AskedRun, ask

from shoot.cli.app import run
from shoot.studies.depth import DepthStudy, format_depth_study, study_depth


def depth_study(config: AskedRun) -> DepthStudy:
    """Ask a camera planner with its own depths, with the lidar's, and without any."""
    return ask(config, study_depth, format_depth_study)


if __name__ == "__main__":
    run(AskedRun, depth_study, "How well does a camera planner see depth?")
