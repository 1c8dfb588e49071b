"""Two other scores of a driven route: Bench2Drive's, and one as nuPlan's closed loop has it."""

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from math import prod
from typing import Any

import numpy as np
from jaxtyping import Float

from shoot.metrics.driving_score.score import DrivingScore
from shoot.metrics.driving_score.tracks import Kind

Array = np.ndarray[Any, np.dtype[Any]]

PENALTIES = {"pedestrian": 0.5, "vehicle": 0.6, "static": 0.65, "red light": 0.7, "stop": 0.8}
_INFRACTION: dict[Kind, str] = {
    "car": "vehicle",
    "truck": "vehicle",
    "bicycle": "vehicle",
    "pedestrian": "pedestrian",
    "object": "static",
}

# nuPlan: progress below this share of the reference's counts as none; the mean speed above the
# limit that costs all.
PROGRESS_AT_LEAST = 0.2
TOO_FAST_MPS = 2.23


@dataclass(frozen=True)
class Bench2Drive:
    """Bench2Drive's driving score of one route, 0 to 1, and whether it was a success.

    A mean over routes counts one that crashed, or was not driven for any other reason, as 0.
    """

    score: float
    is_success: bool


def bench2drive(
    completion: float, hit: Iterable[Kind], red_lights: int = 0, stop_signs: int = 0
) -> Bench2Drive:
    """Completion times a penalty for each infraction; a success is complete and has none.

    Args:
        completion: Share of the route that was driven; more than 1 counts as 1.
        hit: Kinds of those that were hit. It is the caller's choice whether only at fault.
        red_lights: How many were run.
        stop_signs: How many were passed over.
    """
    infractions = Counter(_INFRACTION[kind] for kind in hit)
    infractions += Counter({"red light": red_lights, "stop": stop_signs})
    completion = float(np.clip(completion, 0.0, 1.0))
    penalty = prod(PENALTIES[name] ** count for name, count in infractions.items())
    return Bench2Drive(completion * penalty, completion == 1.0 and not infractions)


def speed_limit(speed_mps: Float[Array, " T"], limit_mps: Float[Array, " T"]) -> float:
    """How far the limit is kept: 1 if always, 0 from 2.23 m/s above it on average on."""
    over_mps = np.maximum(speed_mps - limit_mps, 0.0).mean()
    return float(max(0.0, 1.0 - over_mps / TOO_FAST_MPS))


def nuplan_closed_loop(score: DrivingScore, speed_limit: float) -> float:
    """A score with the weights of nuPlan's closed loop, of our sub-scores: 0 to 1.

    (NC * DAC * [progress at least 0.2] * DDC) * (5 EP + 5 TTC + 4 speed limit + 2 comfort) / 16. It
    is not nuPlan's: sub-scores are those of EPDMS, which are near theirs and not the same.

    Args:
        score: Best with nuPlan's tolerance of 0.3 m.
        speed_limit: See the function `speed_limit`.
    """
    multiplier = score.nc * score.dac * score.ddc * (score.ep >= PROGRESS_AT_LEAST)
    weighted = 5.0 * score.ep + 5.0 * score.ttc + 4.0 * speed_limit + 2.0 * score.hc
    return float(multiplier * weighted / 16.0)
