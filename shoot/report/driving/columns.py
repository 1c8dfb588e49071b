"""Sub-scores and facts: their names, and how they are read from results."""

from collections.abc import Mapping
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
        Column(key, "factors" if key in _FACTORS else "weighted", key.upper(), 2, True)
        for key in SUB_SCORES
    ),
)
FACTS: Final = (
    Column("collisions_at_fault", "collisions at fault"),
    Column("red_lights", "red lights run"),
    Column("off_road_m", "off the road, m", decimals=1),
    Column("against_m", "in no lane, m", decimals=1),
    Column("off_route_m", "off the route, m", decimals=1),
    Column("progress_m", "progress, m", decimals=0, high_is_good=True),
    Column("stuck_s", "stuck, s", decimals=1),
)


def interval_of(value: object) -> Interval:
    """A number of a result, or `{"value", "low", "high"}`; what is not there is no number."""
    if isinstance(value, Mapping):
        return Interval(*(_number(value.get(name)) for name in ("value", "low", "high")))
    return Interval(_number(value), NAN, NAN)


def scores_of(summary: Row) -> dict[str, Interval]:
    """Driving score and sub-scores of a summary, or of what it has more than another."""
    return _intervals({SCORE.key: summary.get(SCORE.key), **summary.get("sub_scores", {})})


def facts_of(summary: Row) -> dict[str, Interval]:
    """Its facts."""
    return _intervals(summary.get("facts", {}))


def _intervals(values: Row) -> dict[str, Interval]:
    return {key: interval_of(value) for key, value in values.items()}


def _number(value: object) -> float:
    return float(value) if isinstance(value, int | float) else NAN
