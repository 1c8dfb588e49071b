"""What a planner's training can be told, and the named presets."""

from dataclasses import dataclass, field, replace

from lss_core.config import DataConfig
from shoot.planner import PlannerConfig
from shoot.training.config import RunConfig
from shoot.training.cpu_sizes import CPU_IMAGE, CPU_MODEL, CPU_OPTIM


@dataclass(frozen=True, kw_only=True)
class TrainConfig(RunConfig):
    """One training run of a planner.

    Attributes:
        templates: Template file, made by shoot-fit-templates.
        planner: How costs are laid out and read, and the loss.
    """

    templates: str
    planner: PlannerConfig = field(default_factory=PlannerConfig)

    def what_is_computed(self) -> "TrainConfig":
        """The same wherever things are; the run has its own copy of the templates."""
        return replace(super().what_is_computed(), templates="-")


# All samples at each of its 300 validations would be more images than it trains on.
PAPER = TrainConfig(templates="templates.npz", out="runs/paper", val_samples=600)
SMALL = TrainConfig(
    templates="templates.npz",
    out="runs/small",
    data=DataConfig(image=CPU_IMAGE),
    model=CPU_MODEL,
    optim=CPU_OPTIM,
    val_every=800,
    val_samples=400,
    num_workers=0,  # on two cores a worker takes more time from the convolutions than it saves
    accelerator="cpu",
    precision="auto",
)
DEMO = replace(
    SMALL,
    out="runs/demo",
    optim=replace(SMALL.optim, steps=450, warmup_steps=45),
    val_every=150,
    val_samples=120,
)
LIDAR1 = replace(SMALL, out="runs/lidar1", data=replace(SMALL.data, lidar_scans=1))
LIDAR10 = replace(SMALL, out="runs/lidar10", data=replace(SMALL.data, lidar_scans=10))

PRESETS: dict[str, tuple[str, TrainConfig]] = {
    "demo": ("Minutes on a laptop's CPU, on the synthetic world.", DEMO),
    "small": ("The preset of our reported results: 20 minutes on two cores.", SMALL),
    "lidar1": ("As small, from one lidar scan instead of the cameras.", LIDAR1),
    "lidar10": ("As small, from ten lidar scans (half a second, ego motion undone).", LIDAR10),
    "paper": ("The paper's sizes: EfficientNet-B0, 128x352, 200x200 cells, 300k steps.", PAPER),
}
