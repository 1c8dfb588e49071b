from .config import OptimConfig as OptimConfig
from .config import RunConfig as RunConfig
from .data import TaskData as TaskData
from .loop import fit as fit
from .module import TaskModule as TaskModule
from .planning.config import TrainConfig as TrainConfig
from .planning.data import LabelledSplit as LabelledSplit
from .planning.data import PlanBatch as PlanBatch
from .planning.data import load_split as load_split
from .planning.run_folder import PlanningRun as PlanningRun
from .planning.task import Planning as Planning
from .planning.task import PlanningModule as PlanningModule
from .planning.task import train as train
from .run_folder import RunFolder as RunFolder
from .task import Task as Task

__all__ = [
    "LabelledSplit",
    "OptimConfig",
    "PlanBatch",
    "Planning",
    "PlanningModule",
    "PlanningRun",
    "RunConfig",
    "RunFolder",
    "Task",
    "TaskData",
    "TaskModule",
    "TrainConfig",
    "fit",
    "load_split",
    "train",
]
