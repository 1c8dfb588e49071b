"""All sub-scores and their sum: the driving score by the rules of EPDMS."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from shoot.metrics.driving_score.collisions import find_contacts, no_collision
from shoot.metrics.driving_score.lights import red_touches, traffic_light
from shoot.metrics.driving_score.progress import ego_progress, measure_progress
from shoot.metrics.driving_score.road import (
    drivable_area,
    driving_direction,
    is_against,
    lane_keeping,
)
from shoot.metrics.driving_score.smoothness import (
    PLAN_GAP_S,
    extended_comfort,
    feel,
    history_comfort,
)
from shoot.metrics.driving_score.surroundings import Surroundings, locate
from shoot.metrics.driving_score.time_to_collision import time_to_collision
from shoot.metrics.driving_score.tracks import Others, Track

NAME = "driving score (EPDMS rules, v1)"

MULTIPLIERS = ("nc", "dac", "ddc", "tlc")
WEIGHTS = {"ep": 5.0, "ttc": 5.0, "lk": 2.0, "hc": 2.0, "ec": 2.0}
SUB_SCORES = (*MULTIPLIERS, *WEIGHTS)


@dataclass(frozen=True)
class DrivingScore:
    """All nine sub-scores, their sum, and what was switched how. Scores are 0 to 1, high is good.

    Attributes:
        nc: No collision at fault.
        dac: Drivable area.
        ddc: Driving direction.
        tlc: Traffic lights.
        ep: Progress.
        ttc: Time to collision.
        lk: Lane keeping.
        hc: Comfort, history included.
        ec: Agreement of plans; None if there were fewer than two, and then its weight is left out.
        progress_m: Metres along the route.
        drivable_tolerance_m: Switch: how far corners may stand out from drivable ground.
        strict_lights: Switch: whether also those may not be behind a red light who were inside
            already when it turned.
        forgiven: Sub-scores that count as 1 because the recorded driver has 0 in them.
        has_human_filter: Switch: whether any could be.
        name: Of the metric, with its version.
    """

    nc: float
    dac: float
    ddc: float
    tlc: float
    ep: float
    ttc: float
    lk: float
    hc: float
    ec: float | None
    progress_m: float
    drivable_tolerance_m: float = 0.0
    strict_lights: bool = False
    forgiven: tuple[str, ...] = ()
    has_human_filter: bool = False
    name: str = NAME

    @property
    def multiplier(self) -> float:
        """NC * DAC * DDC * TLC."""
        return self.nc * self.dac * self.ddc * self.tlc

    @property
    def total(self) -> float:
        """Multiplier * (5 EP + 5 TTC + 2 LK + 2 HC + 2 EC) / 16."""
        values = {name: getattr(self, name) for name in WEIGHTS}
        known = {name: value for name, value in values.items() if value is not None}
        weighted = sum(WEIGHTS[name] * value for name, value in known.items())
        return float(self.multiplier * weighted / sum(WEIGHTS[name] for name in known))

    @property
    def counted_progress_m(self) -> float:
        """Progress times the multipliers: of the reference, what others are measured by."""
        return self.progress_m * self.multiplier


def epdms(
    ego: Track,
    others: Others,
    around: Surroundings,
    *,
    reference_progress_m: float,
    history: Track | None = None,
    plans: Sequence[Track] = (),
    plan_gap_s: float = PLAN_GAP_S,
    drivable_tolerance_m: float = 0.0,
    strict_lights: bool = False,
    human: DrivingScore | None = None,
) -> DrivingScore:
    """Score what was driven by the rules of EPDMS, see docs/driving_score.md.

    The track may be a plan as a controller would drive it, or a whole route that was driven.

    Args:
        ego: What is scored.
        others: At the ego's steps; some steps more let TTC look beyond its end.
        around: Road, lanes, route and lights, in the same frame.
        reference_progress_m: What a rule-driven car got in the ego's place in metres along the
            route, times its own multipliers: its `DrivingScore.counted_progress_m`.
        history: What came before the first step of `ego`, up to one step before it: 1.5 s. Without
            it comfort is that of `ego` alone.
        plans: Made one after another `plan_gap_s` apart, each as a track that begins when it was
            made, in any frame.
        plan_gap_s: Time from plan to plan.
        drivable_tolerance_m: 0 as navsim, 0.3 as nuPlan.
        strict_lights: Count as navsim does a light that turns red while the ego is inside.
        human: The recorded driver's score: sub-scores in which it is 0 count as 1 (navsim's filter
            for real recordings).

    Raises:
        ValueError: If lengths or time steps do not fit together, or there are fewer than 4 steps.
    """
    if others.yaw_rad.shape[1] < len(ego):
        raise ValueError(
            f"Others must be known at the ego's {len(ego)} steps, got {others.yaw_rad.shape[1]}."
        )
    where = locate(ego, around)
    score = DrivingScore(
        nc=no_collision(find_contacts(ego, others, where)),
        dac=drivable_area(where, drivable_tolerance_m),
        ddc=driving_direction(ego, is_against(ego, around, where)),
        tlc=traffic_light(red_touches(ego, around, where, strict_lights)),
        ep=1.0,
        ttc=time_to_collision(ego, others, where),
        lk=lane_keeping(ego, around, where),
        hc=history_comfort(feel(ego if history is None else ego.after(history))),
        ec=extended_comfort(plans, plan_gap_s),
        progress_m=measure_progress(ego, around),
        drivable_tolerance_m=drivable_tolerance_m,
        strict_lights=strict_lights,
    )
    ep = ego_progress(score.progress_m, score.multiplier, reference_progress_m)
    score = replace(score, ep=ep)
    return score if human is None else forgive(score, human)


def forgive(score: DrivingScore, human: DrivingScore) -> DrivingScore:
    """The score with 1 in every sub-score that the recorded driver has 0 in."""
    names = tuple(name for name in SUB_SCORES if getattr(human, name) == 0.0)
    ones: dict[str, Any] = dict.fromkeys(names, 1.0)
    return replace(score, **ones, forgiven=names, has_human_filter=True)
