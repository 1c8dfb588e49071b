"""What a segmentation's training can be told, and the named presets."""

from dataclasses import dataclass, replace
from typing import Annotated, ClassVar, Literal

from lss_core.bounds import Bounds, SettingError
from lss_core.config import DataConfig
from lss_core.grid import BevGrid
from shoot.training.config import RunConfig
from shoot.training.cpu_sizes import CPU_IMAGE, CPU_MODEL, CPU_OPTIM


@dataclass(frozen=True, kw_only=True)
class SegmentConfig(RunConfig):
    """One training run of a segmentation.

    Paper: section 5 (binary cross-entropy; positive weight 5.0 for lanes, 1.0 for all else).
    Deviation: which classes share a network, see docs/deviations.md.

    Attributes:
        classes: Channels of the map, trained together.
        pos_weights: How much a cell of a class counts beside one that is not, class by class.
        rule: Which cells are of a class: those whose `centre` lies within, or as the `released`
            code fills them.
    """

    task: ClassVar[str] = "segmentation"

    classes: tuple[str, ...] = ("car", "vehicle", "drivable", "lane_boundary")
    pos_weights: Annotated[tuple[float, ...], Bounds(0.0, 1e6, low_is_in=False)] = (
        1.0, 1.0, 1.0, 5.0,
    )  # fmt: skip
    rule: Literal["centre", "released"] = "centre"

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.classes:
            raise SettingError("classes is empty, but must name one or more, such as vehicle.")
        twice = sorted({name for name in self.classes if self.classes.count(name) > 1})
        if twice:
            raise SettingError(f"classes names {twice[0]} twice, but must name each once.")
        if len(self.pos_weights) != len(self.classes):
            raise SettingError(
                f"There are {len(self.classes)} classes but {len(self.pos_weights)} pos_weights; "
                "there must be one for each."
            )


# All samples at each of its 300 validations would be more images than it trains on.
SEGMENT_PAPER = SegmentConfig(out="runs/segment-paper", val_samples=600)
SEGMENT = SegmentConfig(
    out="runs/segment",
    data=DataConfig(image=CPU_IMAGE),
    # The paper's 100 m x 100 m: what is behind counts as what is ahead. They are twice the cells
    # of a planner's map, which leaves time for fewer steps.
    model=replace(CPU_MODEL, grid=BevGrid(cell_m=1.0)),
    optim=replace(CPU_OPTIM, steps=4000),
    # Cars are 0.3 % of the cells. Weighed as others, so few steps make none of them probable.
    pos_weights=(10.0, 10.0, 1.0, 5.0),
    val_every=800,
    val_samples=400,
    num_workers=0,  # as for planning
    accelerator="cpu",
    precision="auto",
)

PRESETS: dict[str, tuple[str, SegmentConfig]] = {
    "segment": ("Segmentation, small enough for two cores without a GPU.", SEGMENT),
    "segment-paper": ("Segmentation at the paper's sizes, 300k steps.", SEGMENT_PAPER),
}
