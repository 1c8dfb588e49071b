"""Drivers that choose among templates, by a distribution over them that each makes in its way."""

from abc import ABC, abstractmethod
from typing import Any

import numpy as np
import torch

from lss_core.batch import collate
from lss_core.errors import DataError
from shoot.baselines.prior import fit_prior
from shoot.prediction.run import TrainedRun
from shoot.simulation.drivers.choice import Choose, least_far, mean_distances, most_probable
from shoot.simulation.drivers.seen import read_sights
from shoot.simulation.drivers.simple import foreseen_points
from shoot.simulation.observation import Observation
from shoot.simulation.plan import CostMap, Plan
from shoot.simulation.route_gate import on_route, pass_gate
from shoot.templates import TemplateSet
from shoot.training.planning.motion import TrainingMotion
from shoot.training.planning.run_folder import PlanningRun

Array = np.ndarray[Any, np.dtype[Any]]


class TemplateDriver(ABC):
    """Plans templates.

    Attributes:
        name: For tables.
        cameras, num_scans: What it reads, see `Driver`.

    Args:
        templates: What it chooses from.
        choose: The most probable one, or the one least far on average from one that is drawn.
        has_gate: Whether templates that leave the route are masked.
    """

    name: str
    cameras: tuple[str, ...] = ()
    num_scans: int = 0

    def __init__(
        self, templates: TemplateSet, choose: Choose = "most_probable", has_gate: bool = False
    ) -> None:
        self._templates = templates
        self._points_m = templates.points.astype(np.float64)
        self._dt_s = templates.dt_s
        self._has_gate = has_gate
        self._distance_m = mean_distances(self._points_m) if choose == "expected" else None

    @abstractmethod
    def log_prob(self, observation: Observation) -> Array:
        """[K] log-probabilities in nats, before the gate."""

    def weigh(self, observation: Observation) -> tuple[Array, CostMap | None]:
        """The same, and the map that it comes from, if from one."""
        return self.log_prob(observation), None

    def plan(self, observation: Observation) -> Plan:
        """The template chosen."""
        log_prob, cost_map = self.weigh(observation)
        is_gate_void = False
        if self._has_gate:
            world = observation.world
            route = world.traffic.route
            stays = on_route(self._points_m, observation.state, world.town, route, world.route_at_m)
            gated = pass_gate(log_prob, stays)
            is_gate_void = gated is None
            log_prob = log_prob if gated is None else gated
        if self._distance_m is None:
            chosen = most_probable(log_prob)
        else:
            chosen = least_far(log_prob, self._distance_m)
        points_m = self._points_m
        return Plan(
            points_m[chosen], self._dt_s, chosen, log_prob, is_gate_void, points_m, cost_map
        )


class RunDriver(TemplateDriver):
    """A trained planner: of cameras or of lidar scans."""

    name = "run"

    def __init__(
        self, run: TrainedRun, choose: Choose = "most_probable", has_gate: bool = False
    ) -> None:
        super().__init__(run.templates, choose, has_gate)
        self._run = run
        data = run.config.data
        self.cameras = () if data.lidar_scans else data.cameras
        self.num_scans = data.lidar_scans

    def log_prob(self, observation: Observation) -> Array:
        """What the network says.

        Raises:
            DataError: If it says no finite numbers.
        """
        return self.weigh(observation)[0]

    @torch.no_grad()
    def weigh(self, observation: Observation) -> tuple[Array, CostMap | None]:
        """What the network says, and its cost map.

        Raises:
            DataError: If it says no finite numbers.
        """
        sample = read_sights(observation.sights, self._run.config.data)
        cost_maps = self._run.module.cost_maps(collate([sample]).to(self._run.device))
        scores = self._run.module.outputs(cost_maps)
        log_prob: Array = scores[0].float().log_softmax(dim=-1).cpu().numpy()
        if not np.isfinite(log_prob).all():
            raise DataError("The planner gives no finite scores.")
        cost = cost_maps[0].float().mean(dim=0).cpu().numpy()
        return log_prob, CostMap(cost, self._run.config.model.grid)


class PriorDriver(TemplateDriver):
    """Knows only how often each template was driven in training."""

    name = "prior"

    def __init__(
        self, run: PlanningRun, choose: Choose = "most_probable", has_gate: bool = False
    ) -> None:
        templates = run.templates()
        super().__init__(templates, choose, has_gate)
        motion = TrainingMotion.load(run.motion_file, templates)
        self._log_prior = fit_prior(motion.labels, motion.past.scene, len(templates.points))

    def log_prob(self, observation: Observation) -> Array:
        """The same at all times."""
        return self._log_prior


class OracleDriver(TemplateDriver):
    """The template nearest to what the rules would do: the best that templates allow."""

    name = "oracle"

    def log_prob(self, observation: Observation) -> Array:
        """Certain of one."""
        future_m = foreseen_points(observation, self._points_m.shape[1], self._dt_s)
        log_prob = np.full(len(self._points_m), -np.inf)
        log_prob[self._templates.nearest(future_m[None])] = 0.0
        return log_prob
