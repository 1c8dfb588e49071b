"""The training runs behind the paper's Tables 1, 2 and 5."""

from run_queue import Experiment

SEEDS = (0, 1, 2)
OURS = "ours"
CLASSES = {
    "car": "car",
    "vehicle": "vehicle",
    "drivable": "drivable area",
    "lane_boundary": "lane boundary",
}
# From images, in the paper's order.
CAMERAS = {
    "cnn": "CNN",
    "frozen": "frozen encoder",
    "oft": "OFT",
    "uniform": "uniform depth",
    OURS: "Lift-Splat",
    "scratch": "Lift-Splat, begun at random",
    "fine-depth": "Lift-Splat, depths 1 m apart",
}
LIDARS = {"lidar1": "lidar, 1 scan", "lidar10": "lidar, 10 scans"}
METHODS = CAMERAS | LIDARS

# What the paper's image networks know beforehand is ImageNet, all of these know what a planner has
# learned of such a city.
LEARNED = ("--model.pretrained", "templates/synthetic-1000/weights.safetensors")
FLAGS = {
    OURS: LEARNED,
    "frozen": ("--model.freeze-encoder", *LEARNED),
    "cnn": ("--model.lift", "cnn", *LEARNED),
    "uniform": ("--model.lift", "uniform", *LEARNED),
    "oft": ("--model.lift", "oft", *LEARNED),
    "lidar10": ("--data.lidar-scans", "10"),
    "lidar1": ("--data.lidar-scans", "1"),
    "scratch": (),
    "fine-depth": ("--model.depth.step-m", "1.0", *LEARNED),
}
_ONE_SEED = ("frozen", "uniform", "scratch", "fine-depth")

# Half of the preset's, on half of the scenes: the runs are compared with each other only.
_STEPS = ("--optim.steps", "2000")


def run_of(method: str, seed: int) -> Experiment:
    """The run of a method."""
    return Experiment(method, "segment", seed, (*FLAGS[method], *_STEPS))


# The first seed of all comes first: then every row is there.
ALL = tuple(
    run_of(method, seed)
    for seed in SEEDS
    for method in FLAGS
    if seed == 0 or method not in _ONE_SEED
)
