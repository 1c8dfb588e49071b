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
from .segmentation.config import SegmentConfig as SegmentConfig
from .segmentation.data import SegmentBatch as SegmentBatch
from .segmentation.data import SegmentSplit as SegmentSplit
from .segmentation.task import Segmentation as Segmentation
from .segmentation.task import segment as segment
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
    "SegmentBatch",
    "SegmentConfig",
    "SegmentSplit",
    "Segmentation",
    "Task",
    "TaskData",
    "TaskModule",
    "TrainConfig",
    "fit",
    "load_split",
    "segment",
    "train",
]
