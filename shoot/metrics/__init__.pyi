from .bootstrap import GroupBootstrap as GroupBootstrap
from .bootstrap import Interval as Interval
from .calibration import (
    brier_score as brier_score,
)
from .calibration import (
    calibration_error as calibration_error,
)
from .calibration import (
    measure_reliability as measure_reliability,
)
from .comfort import measure_comfort as measure_comfort
from .displacement import expected_ade as expected_ade
from .displacement import open_loop_l2 as open_loop_l2
from .manoeuvres import classify_manoeuvres as classify_manoeuvres
from .ranks import (
    LabelRanks as LabelRanks,
)
from .ranks import (
    PlanningMetrics as PlanningMetrics,
)
from .ranks import (
    TemplateErrors as TemplateErrors,
)
from .ranks import (
    min_ade as min_ade,
)
from .ranks import (
    min_fde as min_fde,
)
from .ranks import (
    misses as misses,
)
from .ranks import (
    negative_log_likelihood as negative_log_likelihood,
)
from .ranks import (
    rank_labels as rank_labels,
)
from .ranks import (
    template_errors as template_errors,
)
from .ranks import (
    top_templates as top_templates,
)

__all__ = [
    "GroupBootstrap",
    "Interval",
    "LabelRanks",
    "PlanningMetrics",
    "TemplateErrors",
    "brier_score",
    "calibration_error",
    "classify_manoeuvres",
    "expected_ade",
    "measure_comfort",
    "measure_reliability",
    "min_ade",
    "min_fde",
    "misses",
    "negative_log_likelihood",
    "open_loop_l2",
    "rank_labels",
    "template_errors",
    "top_templates",
]
