"""What drivers die of: classes of failing, each measured on a route by a number and a bound."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from lss_core.geometry import FloatArray
from shoot.simulation.routes.result_files import Row
from shoot.templates import TemplateSet

# A template's own speed at its begin is that of its first half second.
_BEGIN_S = 0.5


@dataclass(frozen=True)
class Failing:
    """One way to fail. A route can fail in several.

    Attributes:
        words: What is said of it, with its bound.
        measure: Of a route's result and its speed jumps: how clear it is; failing from `bound` on.
        bound: See `measure`.
    """

    words: str
    measure: Callable[[Row, FloatArray], float]
    bound: float


def _facts(name: str) -> Callable[[Row, FloatArray], float]:
    return lambda row, _: float(row["facts"][name])


def _drift_m(row: Row, _: FloatArray) -> float:
    """Metres off road or in no lane, of who stays on the route."""
    facts = row["facts"]
    stays = facts["off_route_m"] < FAILINGS["turns off"].bound
    return float(facts["off_road_m"] + facts["against_m"]) if stays else 0.0


def _creep(row: Row, _: FloatArray) -> float:
    """Share of the progress that is missing, of who neither stands nor leaves the route."""
    facts = row["facts"]
    goes = facts["stuck_s"] < FAILINGS["freezes"].bound
    stays = facts["off_route_m"] < FAILINGS["turns off"].bound
    return 1.0 - float(row["scores"]["ep"]) if goes and stays else 0.0


FAILINGS = {
    "forgets its speed": Failing(
        "a plan begins 4 m/s or more from the speed that the car has",
        lambda row, jumps_mps: float(jumps_mps.max()) if len(jumps_mps) else np.nan,
        4.0,
    ),
    "turns off": Failing("2 m or more off its route", _facts("off_route_m"), 2.0),
    "drifts": Failing("2 m or more off the road or in no lane, on its route", _drift_m, 2.0),
    "creeps": Failing(
        "half of the progress is missing, neither standing nor off its route", _creep, 0.5
    ),
    "freezes": Failing("stands for 2 s or more, and nothing shows why", _facts("stuck_s"), 2.0),
    "runs a red light": Failing("at least one", _facts("red_lights"), 1.0),
    "hits": Failing("a collision at fault", _facts("collisions_at_fault"), 1.0),
}


def speed_jumps_mps(row: Row, templates: TemplateSet | None) -> FloatArray:
    """[plans] how far the first speed of each template is from that of the car; empty without.

    Args:
        row: Result of a route.
        templates: That it drove by.
    """
    chosen = row["plans"]["template"]
    if templates is None or None in chosen:
        return np.empty(0)
    step = round(_BEGIN_S / templates.dt_s)
    begins_mps = np.linalg.norm(templates.points[:, step - 1], axis=-1) / (step * templates.dt_s)
    ego = row["ego"]
    steps = np.round(np.array(row["plans"]["time_s"]) / ego["dt_s"]).astype(int)
    had_mps = np.array(ego["speed_mps"])[steps]
    jumps_mps: FloatArray = np.abs(begins_mps[chosen] - had_mps)
    return jumps_mps


def failings_of(row: Row, jumps_mps: FloatArray) -> dict[str, float]:
    """How clear each failing is on a route; NaN where it cannot be told."""
    return {name: failing.measure(row, jumps_mps) for name, failing in FAILINGS.items()}
