"""Who chooses among templates: by what distribution, and which of it."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from world_fixture import TinyRun

from shoot.prediction.run import open_run
from shoot.simulation.drivers.choice import least_far, mean_distances, most_probable
from shoot.simulation.drivers.templates import OracleDriver, PriorDriver, RunDriver
from shoot.simulation.observation import Observation
from shoot.simulation.senses import SensorSettings
from shoot.simulation.simulator import Simulator
from shoot.templates import TemplateSet
from shoot.training.planning.run_folder import PlanningRun
from shoot.world.town.roads import make_town

# Four ways straight on, 0 m apart at the start and 1, 2 and 10 m at the end.
FAN = np.stack([np.outer(np.linspace(0.05, 1.0, 20), [20.0, d]) for d in (0.0, 1.0, 2.0, 12.0)])


def test_distances_are_means_over_points() -> None:
    distance_m = mean_distances(FAN)
    assert distance_m[0, 1] == pytest.approx(0.525)
    assert distance_m[3, 1] == pytest.approx(11 * 0.525)
    np.testing.assert_allclose(distance_m, distance_m.T)


def test_the_middle_of_a_distribution_may_not_be_its_top() -> None:
    """The top is far from the rest, which lies together."""
    log_prob = np.log([0.2, 0.2, 0.2, 0.4])
    assert most_probable(log_prob) == 3
    # Times 0.525 m: 0 is 0.2 + 0.4 + 4.8, 1 is 0.4 + 4.4, 2 is 0.4 + 0.2 + 4.0, 3 is 6.6 away.
    assert least_far(log_prob, mean_distances(FAN)) == 2


def test_what_is_masked_is_not_chosen() -> None:
    with np.errstate(divide="ignore"):
        log_prob = np.log([0.5, 0.0, 0.5, 0.0])
    assert most_probable(log_prob) in (0, 2)
    assert least_far(log_prob, mean_distances(FAN)) in (0, 2)


@pytest.fixture(scope="module")
def observation(tiny_run: TinyRun) -> Observation:
    """A car under way, with images as the tiny run reads them."""
    cameras = open_run(tiny_run.folder).config.data.cameras
    car = SensorSettings(image_scale=0.05, cameras=cameras, num_scans=0)
    return Simulator(make_town(5), 2, "replay", car, 7.0).reset()


def test_a_run_says_what_its_network_says_and_the_gate_masks_some_of_it(
    observation: Observation, tiny_run: TinyRun
) -> None:
    run = open_run(tiny_run.folder)
    free, gated = RunDriver(run), RunDriver(run, has_gate=True)
    plan, on_route = free.plan(observation), gated.plan(observation)
    assert plan.log_prob is not None
    assert on_route.log_prob is not None
    assert np.exp(plan.log_prob).sum() == pytest.approx(1.0, abs=1e-5)
    assert plan.template_idx == int(np.argmax(plan.log_prob))
    np.testing.assert_array_equal(plan.points_m, run.templates.points[plan.template_idx])
    kept = np.isfinite(on_route.log_prob)
    # The hand-made drives that these templates are of turn both ways.
    assert 0 < kept.sum() < len(kept)
    assert not on_route.is_gate_void
    assert on_route.template_idx == np.flatnonzero(kept)[np.argmax(plan.log_prob[kept])]
    np.testing.assert_allclose(
        on_route.log_prob[kept] - plan.log_prob[kept],
        -np.log(np.exp(plan.log_prob[kept]).sum()),
        atol=1e-5,
    )


def test_off_the_route_the_gate_masks_nothing_and_says_so(
    observation: Observation, tiny_run: TinyRun
) -> None:
    lost = replace(observation, state=replace(observation.state, x_m=-500.0))
    run = open_run(tiny_run.folder)
    plan = RunDriver(run, has_gate=True).plan(lost)
    assert plan.is_gate_void
    np.testing.assert_array_equal(plan.log_prob, RunDriver(run).plan(lost).log_prob)


def test_the_prior_drives_what_was_driven_most(observation: Observation, tiny_run: TinyRun) -> None:
    run = PlanningRun(Path(tiny_run.folder))
    plan = PriorDriver(run).plan(observation)
    with np.load(run.motion_file) as stored:
        counts = np.bincount(stored["labels"], minlength=len(run.templates().points))
    assert plan.template_idx is not None
    assert counts[plan.template_idx] == counts.max()


def test_the_oracle_takes_the_template_nearest_to_what_the_rules_would_do(
    observation: Observation, tiny_run: TinyRun
) -> None:
    templates: TemplateSet = open_run(tiny_run.folder).templates
    plan = OracleDriver(templates).plan(observation)
    state = observation.state
    xy_m, _, _ = observation.world.traffic.foresee(5.0)
    away = xy_m - [state.x_m, state.y_m]
    cos, sin = np.cos(state.yaw_rad), np.sin(state.yaw_rad)
    future_m = away @ np.array([[cos, -sin], [sin, cos]])
    # At whole half seconds, which both know.
    apart_m = np.hypot(*(templates.points[:, 1::2] - future_m[4::5]).T).T
    assert plan.template_idx == int(np.argmin((apart_m**2).sum(axis=1)))
