"""What is done to the cameras: in training, as runs of their own, and when a run is asked."""

from dataclasses import dataclass, field

from planning_table.experiments import HALF_STEPS as HALF_PLAN_STEPS
from run_queue import Experiment
from segmentation_table.experiments import OURS, run_of

from lss_core.config import CAMERAS
from shoot.prediction.disturbance import Disturbance

# Rotation about each axis; a camera that leans by this much also sits this much aside.
NOISE_RAD = (0.01, 0.02, 0.05, 0.1)
_M_PER_RAD = 2.0
TRAINED_NOISE_RAD = (0.02, 0.05)
DROPS = (1, 2, 3, 4, 5)
TRAINED_DROPS = (1, 2)
# The paper's Table 3: four cameras, and two that training never saw.
NEW_CAMERAS = ("CAM_FRONT_LEFT", "CAM_BACK_LEFT")
FOUR = tuple(name for name in CAMERAS if name not in NEW_CAMERAS)

PLAIN = "plain"  # trained as usual
UNDISTURBED = "undisturbed"  # asked as usual
# That of Tables 1 and 2; as in Table 6, in half of the steps.
_AS_USUAL = {
    "segmentation": run_of(OURS, 0),
    "planning": Experiment(PLAIN, "small", 0, HALF_PLAN_STEPS),
}


@dataclass(frozen=True)
class Condition:
    """How a run is asked.

    Attributes:
        name: In records.
        disturbance: What is done to the cameras.
        cameras: Those that there are.
    """

    name: str
    disturbance: Disturbance = field(default_factory=Disturbance)
    cameras: tuple[str, ...] = CAMERAS


def noise_flags(noise_rad: float) -> tuple[str, ...]:
    """What shoot-train is told of noisy mountings."""
    return (
        "--data.extrinsic-noise-rad", f"{noise_rad:g}",
        "--data.extrinsic-noise-m", f"{_M_PER_RAD * noise_rad:g}",
    )  # fmt: skip


def runs_of(task: str) -> dict[str, Experiment]:
    """How it was trained to its run: plain, with noise, with dropped cameras, with four of them."""
    plain = _AS_USUAL[task]
    flags = {
        **{f"noise-{level:g}": noise_flags(level) for level in TRAINED_NOISE_RAD},
        **{f"drop-{num}": ("--data.drop-cameras", str(num)) for num in TRAINED_DROPS},
        "four": ("--data.cameras", *FOUR),
    }
    changed = {
        name: Experiment(name, plain.preset, 0, (*plain.flags, *told))
        for name, told in flags.items()
    }
    return {PLAIN: plain, **changed}


def curves_of(task: str, kind: str) -> list[str]:
    """The runs that are compared as to `noise` or as to `drop`."""
    return [name for name in runs_of(task) if name == PLAIN or name.startswith(kind)]


def conditions_of(trained: str) -> tuple[Condition, ...]:
    """How a run is asked: the curves of Figure 6, the bars of Figure 7, the rows of Table 3."""
    if trained == "four":
        first, second = NEW_CAMERAS
        return (
            Condition("4", cameras=FOUR),
            Condition(f"4 + {first}", cameras=(*FOUR, first)),
            Condition(f"4 + {second}", cameras=(*FOUR, second)),
            Condition("all", cameras=(*FOUR, *NEW_CAMERAS)),
        )
    noise = [
        Condition(f"noise-{level:g}", Disturbance(level, _M_PER_RAD * level)) for level in NOISE_RAD
    ]
    drops = [Condition(f"drop-{num}", Disturbance(drop_cameras=num)) for num in DROPS]
    missing = [Condition(f"without-{name}", Disturbance(missing=(name,))) for name in CAMERAS]
    by_kind = {"noise": noise, "drop": drops, PLAIN: [*noise, *drops, *missing]}
    return Condition(UNDISTURBED), *by_kind[trained.split("-")[0]]
