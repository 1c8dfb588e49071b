"""The fast planner: the slow one's probabilities, compiled or not."""

import json
import logging
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from host_waits import NoHostWaits
from world_fixture import TinyRun, command

from lss_core.batch import Batch
from lss_core.errors import DataError
from shoot.prediction import fast
from shoot.prediction.compiler_cache import frozen_weights, processor_tag
from shoot.prediction.fast import FastPlanner
from shoot.prediction.run import TrainedRun, batches, open_run
from shoot.training.planning.data import load_split
from shoot.training.planning.task import PlanningModule


@pytest.fixture
def trained(tiny_run: TinyRun) -> TrainedRun:
    run = open_run(tiny_run.folder)
    with torch.no_grad():
        run.module.model.bev_encoder.head.weight *= 100.0  # a few steps leave scores almost equal
    return run


def _sensors(run: TrainedRun) -> Batch:
    split = load_split(run.config.data, "val", run.templates)
    return next(iter(batches(run, split, np.arange(3)))).sensors


def _in_float32(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fast, "fastest_precision", lambda _: "32-true")


def test_uncompiled_float32_gives_the_same_scores(
    trained: TrainedRun, monkeypatch: pytest.MonkeyPatch
) -> None:
    _in_float32(monkeypatch)
    sensors = _sensors(trained)
    with torch.no_grad():
        expected = trained.module(sensors)
    assert expected.std() > 0.1
    scores = FastPlanner(trained.module, compiled=False)(sensors)
    torch.testing.assert_close(scores, expected, rtol=1e-4, atol=1e-4)


def _with_lift(trained: TrainedRun, lift: str) -> PlanningModule:
    torch.manual_seed(0)
    config = replace(trained.config, model=replace(trained.config.model, lift=lift))
    return PlanningModule(config, trained.templates).eval()


def test_depths_all_alike_are_predicted_too(
    trained: TrainedRun, monkeypatch: pytest.MonkeyPatch
) -> None:
    _in_float32(monkeypatch)
    sensors, module = _sensors(trained), _with_lift(trained, "uniform")
    with torch.no_grad():
        module.model.bev_encoder.head.weight *= 100.0
        expected = module(sensors)
    assert expected.std() > 0.01
    scores = FastPlanner(module, compiled=False)(sensors)
    torch.testing.assert_close(scores, expected, rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize("lift", ["cnn", "oft"])
def test_other_lifts_are_refused(trained: TrainedRun, lift: str) -> None:
    with pytest.raises(DataError, match=f"whose lift is '{lift}'"):
        FastPlanner(_with_lift(trained, lift))


def test_a_masked_camera_plays_no_part(
    trained: TrainedRun, monkeypatch: pytest.MonkeyPatch
) -> None:
    _in_float32(monkeypatch)
    sensors = _sensors(trained)
    mask = sensors.camera_mask.clone()
    mask[1, 2] = False
    images = sensors.images.clone()
    images[1, 2] = 255
    masked = replace(sensors, camera_mask=mask, images=images)
    with torch.no_grad():
        expected = trained.module(masked)
    scores = FastPlanner(trained.module, compiled=False)(masked)
    torch.testing.assert_close(scores, expected, rtol=1e-4, atol=1e-4)


def test_from_images_to_scores_no_host_would_wait_for_a_gpu(
    trained: TrainedRun, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Else it could not be recorded as a CUDA graph; and the recording holds any calibration."""
    _in_float32(monkeypatch)
    sensors = _sensors(trained)
    with torch.no_grad():
        expected = trained.module(sensors)
    planner = FastPlanner(trained.module, compiled=False)
    for b in range(3):
        one = slice(b, b + 1)
        with NoHostWaits(), torch.no_grad():
            scores = planner._scores_of_images(
                sensors.images[b],
                sensors.pixel_from_camera[one],
                sensors.ego_from_camera[one],
                sensors.camera_mask[one],
            )
        torch.testing.assert_close(scores, expected[one], rtol=1e-4, atol=1e-4)


@pytest.mark.full
def test_compiled_gives_the_same_scores_and_says_what_it_cost(
    trained: TrainedRun, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    _in_float32(monkeypatch)
    sensors = _sensors(trained)
    with torch.no_grad():
        expected = trained.module(sensors)
    planner = FastPlanner(trained.module)
    with caplog.at_level(logging.INFO):
        scores = planner(sensors)
    assert planner.compiled
    assert "Compiled in" in caplog.text
    torch.testing.assert_close(scores, expected, rtol=1e-4, atol=1e-4)


def test_without_a_compiler_it_runs_and_says_so(
    trained: TrainedRun,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
    tmp_path: Path,
) -> None:
    _in_float32(monkeypatch)
    torch._dynamo.reset()
    monkeypatch.setenv("TORCHINDUCTOR_CACHE_DIR", str(tmp_path))
    sensors = _sensors(trained)
    with torch.no_grad():
        expected = trained.module(sensors)
    no_compiler = {"cpp.cxx": ("no-such-compiler",), "fx_graph_cache": False}
    with torch._inductor.config.patch(no_compiler):
        planner = FastPlanner(trained.module)
        scores = planner(sensors)
    assert not planner.compiled
    assert "runs uncompiled" in caplog.text
    torch.testing.assert_close(scores, expected, rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize("compiled", [False, pytest.param(True, marks=pytest.mark.full)])
def test_evaluate_fast(
    compiled: bool, tiny_run: TinyRun, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # As TORCHDYNAMO_DISABLE=1 has it; what compiled networks say is compared above.
    monkeypatch.setattr(torch._dynamo.config, "disable", not compiled)
    reports = []
    for flags in ([], ["--fast"]):
        out = tmp_path / f"{len(reports)}.json"
        said = command("shoot-evaluate", tiny_run.folder, "--out", out, *flags)
        assert said.status == 0, said.err
        reports.append(json.loads(out.read_text()))
    slow, fast_one = (report["methods"]["model"]["nll"]["value"] for report in reports)
    assert fast_one == pytest.approx(slow, abs=1e-3)
    # One that knows no network is the same in both.
    assert reports[0]["methods"]["prior"] == reports[1]["methods"]["prior"]


_SCORES = """
import sys
import torch
from test_fast import _sensors
from shoot.prediction import fast
from shoot.prediction.run import open_run
fast.fastest_precision = lambda device: "32-true"
trained = open_run(sys.argv[1])
with torch.no_grad():
    trained.module.model.bev_encoder.head.weight *= 100.0
planner = fast.FastPlanner(trained.module)
torch.save(planner(_sensors(trained)), sys.argv[2])
assert planner.compiled
"""


@pytest.mark.full
def test_what_was_compiled_for_other_units_is_not_taken(
    tiny_run: TinyRun, trained: TrainedRun, tmp_path: Path
) -> None:
    with torch.no_grad():
        expected = trained.module(_sensors(trained))
    for number, limit in enumerate(({}, {"ONEDNN_MAX_CPU_ISA": "AVX2"})):
        out = tmp_path / f"{number}.pt"
        kept = {"TORCHINDUCTOR_CACHE_DIR": str(tmp_path / "cache"), "OMP_NUM_THREADS": "1"}
        subprocess.run(
            [sys.executable, "-c", _SCORES, tiny_run.folder, out],
            env={**os.environ, **kept, **limit, "PYTHONPATH": str(Path(__file__).parent)},
            check=True,
        )
        scores = torch.load(out, weights_only=True)
        torch.testing.assert_close(scores, expected, rtol=1e-4, atol=1e-4)


def test_processors_are_told_apart_by_what_may_be_used(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("ONEDNN_MAX_CPU_ISA", raising=False)
    whole = processor_tag()
    monkeypatch.setenv("ONEDNN_MAX_CPU_ISA", "AVX2")
    assert processor_tag() != whole
    key = torch.compiler.config.cache_key_tag
    with frozen_weights():
        assert processor_tag() in torch.compiler.config.cache_key_tag
    assert torch.compiler.config.cache_key_tag == key
