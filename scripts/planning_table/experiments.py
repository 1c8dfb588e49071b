"""The training runs behind docs/results.md."""

from data_set import HALF
from run_queue import Experiment

SEEDS = (0, 1, 2)
PLANNERS = {"camera": "camera", "lidar1": "lidar, 1 scan", "lidar10": "lidar, 10 scans"}
# In the paper's order: the second sees more than the first.
PAIRS = (("camera", "lidar1"), ("camera", "lidar10"), ("lidar1", "lidar10"))
MAIN_METRICS = {
    "top5": "top-5, %",
    "top10": "top-10, %",
    "top20": "top-20, %",
    "nll": "NLL, nats",
}


HALF_STEPS = ("--optim.steps", "2800")
# The paper's Table 6.
TABLE = tuple(
    Experiment(planner, preset, seed)
    for seed in SEEDS
    for planner, preset in (("camera", "small"), ("lidar1", "lidar1"), ("lidar10", "lidar10"))
)
# What limits the camera planner: one thing changed at a time.
LIMITS = (
    Experiment("camera-depth", "small", 0, ("--optim.depth-weight", "0.5")),
    # Poses of cameras that fire one after the other say how far the car has moved meanwhile.
    Experiment("camera-static-poses", "small", 0, ("--data.no-ego-motion",)),
    Experiment("camera-half-data", "small", 0, ("--train-split", HALF)),
    Experiment("lidar10-half-data", "lidar10", 0, ("--train-split", HALF)),
    Experiment("camera-half-steps", "small", 0, HALF_STEPS),
    Experiment("lidar10-half-steps", "lidar10", 0, HALF_STEPS),
    Experiment(
        "camera-half-resolution",
        "small",
        0,
        ("--data.image.height-px", "32", "--data.image.width-px", "88"),
    ),
)
# What the planner that the paper started from does otherwise (Neural Motion Planner, section 3.3).
RIVALS = (
    Experiment("camera-volume", "small", 0, ("--planner.cost", "volume")),
    Experiment("camera-margin", "small", 0, ("--planner.loss", "max_margin")),
)
ALL = TABLE + LIMITS + RIVALS
