"""Does a camera planner read the speed of the car from the poses of its cameras?

python scripts/speed_in_poses.py RUN --split val --out pose_speed.json
"""

from asked_run import AskedRun, ask

from shoot.cli.app import run
from shoot.studies.pose_speed import PoseSpeedStudy, format_pose_speed, study_pose_speed


def speed_in_poses(config: AskedRun) -> PoseSpeedStudy:
    """Ask with poses as recorded, and as of a car that drives at other speeds."""
    return ask(config, study_pose_speed, format_pose_speed)


if __name__ == "__main__":
    run(AskedRun, speed_in_poses, "Does a camera planner read the speed from poses?")
