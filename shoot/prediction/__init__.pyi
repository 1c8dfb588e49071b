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
from .segmenter import (
    TrainedSegmenter as TrainedSegmenter,
)
from .segmenter import (
    open_segmenter as open_segmenter,
)
from .segmenter import (
    predict_maps as predict_maps,
)
from .segmenter import (
    segment_batches as segment_batches,
)

__all__ = [
    "FastPlanner",
    "TrainedRun",
    "TrainedSegmenter",
    "batches",
    "open_run",
    "open_segmenter",
    "predict",
    "predict_maps",
    "segment_batches",
]
