"""Sub-scores and facts: their names, and how they are read from results."""

from collections.abc import Iterable, Mapping
from typing import Any, Final

from shoot.metrics.bootstrap import Interval
from shoot.metrics.driving_score.score import SUB_SCORES
from shoot.report.html.columns import Column

Row = Mapping[str, Any]
NAN: Final = float("nan")

SCORE: Final = Column("driving_score", "driving score", decimals=3, high_is_good=True)
WORDS: Final = {
    "nc": "no collision at fault",
    "dac": "on the road",
    "ddc": "not against the traffic",
    "tlc": "no red light run",
    "ep": "progress",
    "ttc": "no near collision",
    "lk": "keeps its lane",
    "hc": "comfort",
    "ec": "plans agree",
}
_FACTORS: Final = ("nc", "dac", "ddc", "tlc")
COLUMNS: Final = (
    SCORE,
    *(
        Column(key, "factors" if key in _FACTORS else "weighted", key.upper(), 3, True)
        for key in SUB_SCORES
    ),
)


def fact_columns(facts: Iterable[str]) -> tuple[Column, ...]:
    """A column each, named as the fact is."""
    return tuple(Column(key, key.replace("_", " "), decimals=2) for key in facts)


def interval_of(value: object) -> Interval:
    """A number of a result, or `{"value", "low", "high"}`; what is not there is no number."""
    if isinstance(value, Mapping):
        return Interval(*(_number(value.get(name)) for name in ("value", "low", "high")))
    return Interval(_number(value), NAN, NAN)


def scores_of(summary: Row) -> dict[str, Interval]:
    """Driving score and sub-scores of a summary."""
    return {
        SCORE.key: interval_of(summary.get(SCORE.key)),
        **{key: interval_of(value) for key, value in summary.get("sub_scores", {}).items()},
    }


def _number(value: object) -> float:
    return float(value) if isinstance(value, int | float) else NAN
