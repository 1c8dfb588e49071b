from .fast import FastPlanner as FastPlanner
from .run import (
    TrainedRun as TrainedRun,
)
from .run import (
    batches as batches,
)
from .run import (
    open_run as open_run,
)
from .run import (
    predict as predict,
)

__all__ = ["FastPlanner", "TrainedRun", "batches", "open_run", "predict"]
