"""All that a film of a drive is made of, gathered while and after it is driven."""

from dataclasses import dataclass, field

import numpy as np

from shoot.rendering.sample_view import Ranking, from_origin
from shoot.simulation.filming.mishaps import Mishap
from shoot.simulation.observation import CameraView, Observation
from shoot.simulation.plan import Plan
from shoot.simulation.route_log import RouteLog
from shoot.world.town.town import Town

Views = tuple[CameraView, ...]

NUM_BEST = 10


class Reel:
    """Keeps what cameras saw at each planning: `drive(..., watch=reel.keep)`."""

    def __init__(self) -> None:
        self._views: list[Views] = []

    def keep(self, observation: Observation, plan: Plan) -> None:
        """One planning more; the plan is in the log."""
        self._views.append(observation.sights.views)

    @property
    def views(self) -> tuple[Views, ...]:
        """Of each planning so far, as files, not yet decoded."""
        return tuple(self._views)


@dataclass(frozen=True)
class Film:
    """A drive, to be shown.

    Attributes:
        town: Where it was.
        log: What happened.
        views: What cameras saw at each of the log's plans; empty if there are none.
        driver: Who drove, in words.
        mishaps: What went wrong, in the order of time.

    Raises:
        ValueError: If there are views, but not for each plan.
    """

    town: Town
    log: RouteLog
    views: tuple[Views, ...] = ()
    driver: str = ""
    mishaps: tuple[Mishap, ...] = ()
    _ranked: dict[int, Ranking | None] = field(default_factory=dict, init=False, compare=False)

    def __post_init__(self) -> None:
        if self.views and len(self.views) != len(self.log.plans):
            raise ValueError(
                f"A film of {len(self.log.plans)} plans needs views of as many, got "
                f"{len(self.views)}."
            )

    @property
    def num_steps(self) -> int:
        """Moments of the log."""
        return len(self.log.ego.yaw_rad)

    @property
    def has_images(self) -> bool:
        """Whether cameras saw anything."""
        return any(self.views)

    def time_s(self, step: int) -> float:
        """When a moment is, since the route began."""
        return round(step * self.log.dt_s, 6)

    def plan_at(self, step: int) -> int | None:
        """Which plan is followed: the last that was made by then; None: no driver has planned."""
        made = [i for i, (time_s, _) in enumerate(self.log.plans) if time_s <= self.time_s(step)]
        return made[-1] if made else None

    def step_of_plan(self, idx: int) -> int:
        """The moment at which a plan was made."""
        return round(self.log.plans[idx][0] / self.log.dt_s)

    def ranking(self, idx: int) -> Ranking | None:
        """The most probable templates of a plan, the plan first; None if it weighed none."""
        if idx not in self._ranked:
            self._ranked[idx] = rank_plan(self.log.plans[idx][1])
        return self._ranked[idx]

    def mishaps_by(self, step: int) -> tuple[Mishap, ...]:
        """What has gone wrong until a moment, that included."""
        return tuple(m for m in self.mishaps if m.time_s <= self.time_s(step) + 1e-6)


def rank_plan(plan: Plan) -> Ranking | None:
    """The plan first, then the best templates beside it; None if it weighed none.

    A driver may choose another template than the most probable: what it drives comes first all the
    same, with its own probability.
    """
    if plan.templates_m is None or plan.log_prob is None or plan.template_idx is None:
        return None
    prob = np.exp(plan.log_prob.astype(np.float64))
    best = np.argsort(-prob, kind="stable")[:NUM_BEST]
    best = best[(prob[best] > 0.0) & (best != plan.template_idx)][: NUM_BEST - 1]
    chosen = np.concatenate([[plan.template_idx], best])
    return Ranking(
        paths_m=np.stack([from_origin(plan.templates_m[k]) for k in chosen]),
        probabilities=prob[chosen],
        strengths=prob[chosen] / max(float(prob.max()), 1e-12),
        num_templates=len(prob),
    )
