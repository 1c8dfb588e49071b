from .config import OptimConfig as OptimConfig
from .config import TrainConfig as TrainConfig
from .data import (
    LabelledSplit as LabelledSplit,
)
from .data import (
    PlanBatch as PlanBatch,
)
from .data import (
    PlanningData as PlanningData,
)
from .data import (
    load_split as load_split,
)
from .loop import PlanningModule as PlanningModule
from .loop import train as train
from .run_folder import RunFolder as RunFolder

__all__ = [
    "LabelledSplit",
    "OptimConfig",
    "PlanBatch",
    "PlanningData",
    "PlanningModule",
    "RunFolder",
    "TrainConfig",
    "load_split",
    "train",
]
