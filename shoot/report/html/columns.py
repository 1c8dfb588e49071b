"""Which metric stands where, under which name, to how many decimals, and which end is good."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

from shoot.metrics.ranks import TOP_KS

SECONDS: Final = (1, 2, 3, 5)
L2_SECONDS: Final = (1, 2, 3)


@dataclass(frozen=True)
class Column:
    """One metric in a table.

    Attributes:
        key: Name in the report.
        heading: Upper line of the header; neighbours with the same one share it.
        label: Lower line of the header; empty where the heading says it all.
        decimals: Digits after the point.
        high_is_good: Whether more is better; None where nobody can say.
    """

    key: str
    heading: str
    label: str = ""
    decimals: int = 2
    high_is_good: bool | None = False

    @property
    def name(self) -> str:
        """Heading and label in one line."""
        return f"{self.heading} {self.label}".strip()


@dataclass(frozen=True)
class Group:
    """Metrics that are read together.

    Attributes:
        title: Heading of the table.
        note: What it is about, in a sentence.
        reading: What its numbers mean.
        columns: Its metrics.
    """

    title: str
    note: str
    reading: str
    columns: tuple[Column, ...]


def _of_k(stem: str, heading: str, decimals: int) -> tuple[Column, ...]:
    return tuple(Column(f"{stem}_{k}", heading, f"k = {k}", decimals) for k in TOP_KS)


def _of_time(stem: str, heading: str, seconds: Iterable[int]) -> tuple[Column, ...]:
    return tuple(Column(f"{stem}_{s}s", heading, f"{s} s") for s in seconds)


TOP_K: Final = tuple(Column(f"top{k}", "Top-k, %", f"k = {k}", 1, True) for k in TOP_KS)
NLL: Final = Column("nll", "NLL, nats")
TOP_10: Final = Column("top10", "top-10, %", "", 1, True)
MAIN: Final = (*TOP_K, NLL)

CALIBRATION: Final = Group(
    "Calibration",
    "Whether probabilities can be believed.",
    "ECE: how far the probability of the most probable template is from how often it is the "
    "label, on average; noise makes it larger, most of all in small samples. Brier score: squared "
    "error of all probabilities, 0 to 2. Expected ADE: mean distance to the driven path, each "
    "template weighed by its probability.",
    (
        Column("ece", "ECE, %", decimals=1),
        Column("brier", "Brier score", decimals=3),
        Column("expected_ade", "Expected ADE, m"),
    ),
)

SAFETY: Final = Group(
    "Collisions and leaving the road",
    "Share of chosen trajectories on which the ego would have touched an annotated road user, "
    "or left the drivable area of the map, up to that time.",
    "The others move as recorded and do not give way. Boxes that the driver's own path touches are "
    "taken to be inexact and left out, so the driven path never collides; where it leaves the "
    "road, the map may be wrong.",
    (
        *_of_time("collision", "Collision, %", SECONDS),
        *_of_time("off_road", "Off the road, %", SECONDS),
    ),
)

GROUPS: Final = (
    CALIBRATION,
    Group(
        "The best of k trajectories",
        "Of the k most probable templates, the one that comes nearest to the driven path.",
        "minADE is its mean distance, minFDE its distance at the end. The miss rate is how often "
        "even the best is somewhere 2 m off or more. The nearest of all templates, which is the "
        "label, is what an always-right planner would choose; it is one trajectory and stands "
        "under k = 1.",
        (
            *_of_k("min_ade", "minADE, m", 2),
            *_of_k("min_fde", "minFDE, m", 2),
            *_of_k("miss_rate", "Miss rate, %", 1),
        ),
    ),
    Group(
        "Distance of the chosen trajectory",
        "The chosen trajectory is the most probable template. Compare left with left and right "
        "with right only.",
        "The two halves follow two conventions for the same words, 'L2 at 3 s': the distance at "
        "that moment (as UniAD reports it), or the mean of the distances every half second up to "
        "it (as ST-P3 and VAD do), which is smaller.",
        (
            *_of_time("l2_at", "L2 at that moment, m", L2_SECONDS),
            *_of_time("l2_upto", "L2, mean up to it, m", L2_SECONDS),
        ),
    ),
    SAFETY,
    Group(
        "Comfort",
        "How the chosen trajectory would feel.",
        "Largest acceleration and jerk on the way, and the share of trajectories that stay within "
        "bounds. Templates are means of many paths and smoother than any of them; standing still "
        "is comfortable at any speed by these figures.",
        (
            Column("lon_accel_mps2", "Along the path, m/s²"),
            Column("lat_accel_mps2", "Across it, m/s²"),
            Column("jerk_mps3", "Jerk, m/s³"),
            Column("comfort", "Comfortable, %", decimals=1, high_is_good=True),
        ),
    ),
)

# What an always-right planner gets is its single choice, so it stands under k = 1.
ORACLE_KEYS: Final = {"ade": "min_ade_1", "fde": "min_fde_1", "miss_rate": "miss_rate_1"}


def other_columns(keys: Iterable[str]) -> tuple[Column, ...]:
    """Columns of metrics no table above knows, under their own names, so that none is lost."""
    known = {column.key for column in MAIN}
    known |= {column.key for group in GROUPS for column in group.columns}
    return tuple(
        Column(key, key, decimals=3, high_is_good=None)
        for key in dict.fromkeys(keys)
        if key not in known
    )
