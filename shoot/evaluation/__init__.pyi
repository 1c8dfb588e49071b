from .comparison import Scored as Scored
from .comparison import compare as compare
from .comparison import score as score
from .comparison import sum_up as sum_up
from .report import condition_of as condition_of
from .report import evaluate as evaluate
from .results import Report as Report
from .results import Results as Results

__all__ = ["Report", "Results", "Scored", "compare", "condition_of", "evaluate", "score", "sum_up"]
