"""The fast planner on a GPU: one CUDA graph, and the module's scores."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from world_fixture import TinyRun

from lss_core.batch import Batch
from shoot.prediction import fast
from shoot.prediction.cuda_graph import CudaGraphs
from shoot.prediction.fast import FastPlanner
from shoot.prediction.run import TrainedRun, batches, open_run
from shoot.training.planning.data import load_split

Sensors = tuple[TrainedRun, Batch]


@pytest.fixture
def trained(tiny_run: TinyRun) -> Sensors:
    run = open_run(tiny_run.folder)
    with torch.no_grad():
        run.module.model.bev_encoder.head.weight *= 100.0  # a few steps leave scores almost equal
    split = load_split(run.config.data, "val", run.templates)
    sensors = next(iter(batches(run, split, np.arange(3)))).sensors.to("cuda")
    run.module.cuda()
    return run, sensors


@pytest.fixture(params=["compiled", "as it is"])
def planner(
    trained: Sensors, request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch
) -> Callable[[Batch], torch.Tensor]:
    monkeypatch.setattr(fast, "fastest_precision", lambda _: "32-true")
    return FastPlanner(trained[0].module, compiled=request.param == "compiled")


def _assert_same(run: TrainedRun, planner: FastPlanner, sensors: Batch) -> None:
    with torch.no_grad():
        expected = run.module(sensors).softmax(dim=-1)
    assert expected.std() > 1e-4
    found = planner(sensors).softmax(dim=-1)
    # Convolutions of a GPU round to ten bits (TF32).
    torch.testing.assert_close(found, expected, rtol=3e-2, atol=1e-3)


def test_the_same_probabilities_from_a_graph(trained: Sensors, planner: FastPlanner) -> None:
    run, sensors = trained
    _assert_same(run, planner, sensors)
    assert planner.recorded, "no CUDA graph could be made"


def test_other_calibrations_images_and_masks_are_what_it_plans_for(
    trained: Sensors, planner: FastPlanner
) -> None:
    run, sensors = trained
    first = planner(sensors)
    poses = sensors.ego_from_camera.clone()
    poses[..., 0, 3] += 3.0
    mask = sensors.camera_mask.clone()
    mask[1, 2] = False
    for other in (
        replace(sensors, ego_from_camera=poses),
        replace(sensors, camera_mask=mask),
        replace(sensors, images=sensors.images.flip(0)),
    ):
        assert not torch.allclose(planner(other), first)
        _assert_same(run, planner, other)
    torch.testing.assert_close(planner(sensors), first)


@pytest.mark.parametrize("num_samples", [1, 2, 3])
def test_batches_of_all_sizes(trained: Sensors, planner: FastPlanner, num_samples: int) -> None:
    run, sensors = trained
    parts = {
        name: getattr(sensors, name)[:num_samples]
        for name in ("images", "pixel_from_camera", "ego_from_camera", "camera_mask", "sample_idx")
    }
    part = replace(sensors, point_counts=sensors.point_counts[:num_samples], **parts)
    _assert_same(run, planner, part)


def test_a_result_is_the_callers_own() -> None:
    twice = CudaGraphs(lambda x: 2.0 * x)
    first = twice(torch.ones(3, device="cuda"))
    second = twice(torch.full((3,), 5.0, device="cuda"))
    assert first.tolist() == [2.0] * 3
    assert second.tolist() == [10.0] * 3
    assert twice(torch.ones(2, 2, device="cuda")).tolist() == [[2.0, 2.0], [2.0, 2.0]]


def test_what_cannot_be_recorded_runs_without(
    trained: Sensors, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """A backbone of a user's that has the host wait."""
    monkeypatch.setattr(fast, "fastest_precision", lambda _: "32-true")
    run, sensors = trained
    handle = run.module.model.image_encoder.register_forward_hook(
        lambda _, __, output: output if float(output[0].sum()) < float("inf") else None
    )
    planner = FastPlanner(run.module, compiled=False)
    _assert_same(run, planner, sensors)
    assert not planner.recorded
    handle.remove()
