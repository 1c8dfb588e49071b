"""Numbers and names as the page writes them."""

import math
from collections.abc import Sequence

from shoot.evaluation.results import MODEL
from shoot.metrics.bootstrap import Interval
from shoot.report.html.columns import Column

DASH = "–"
_MINUS = "−"


def number(value: float, decimals: int, signed: bool = False) -> str:
    """A number to some decimals, a dash if it is none; with its sign, if that matters."""
    if not math.isfinite(value):
        return DASH
    text = f"{abs(value):.{decimals}f}"
    is_zero = not text.strip("0.")
    if value < 0.0 and not is_zero:
        return _MINUS + text
    return f"+{text}" if signed and not is_zero else text


def has_bounds(interval: Interval) -> bool:
    """Whether there are both ends of the interval; a single scene has none."""
    return math.isfinite(interval.low) and math.isfinite(interval.high)


def bounds(interval: Interval, decimals: int, signed: bool = False) -> str:
    """`[low, high]`."""
    low, high = (number(end, decimals, signed) for end in (interval.low, interval.high))
    return f"[{low}, {high}]"


def verdict(difference: Interval, column: Column) -> str:
    """`better` or `worse` where the model differs for sure, empty where it may not."""
    if not difference.excludes_zero or column.high_is_good is None:
        return ""
    return "better" if (difference.low > 0.0) == column.high_is_good else "worse"


def spaced(name: str) -> str:
    """A method's key as words."""
    return name.replace("_", " ")


def listed(names: Sequence[str]) -> str:
    """`a`, `a and b`, `a, b and c`."""
    *others, last = names
    return f"{', '.join(others)} and {last}" if others else last


def row_class(name: str) -> str:
    """What a row of a method is styled by."""
    return "model" if name == MODEL else "method"
