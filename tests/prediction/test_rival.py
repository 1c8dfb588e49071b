"""A planner with a cost volume and the max-margin loss, from training to pictures."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from world_fixture import TinyRun, command, complaint, evaluate, train_flags

from shoot.prediction import fast
from shoot.prediction.fast import FastPlanner
from shoot.prediction.run import TrainedRun, batches, open_run
from shoot.report.sample_views import view_sample
from shoot.studies.depth import study_depth
from shoot.training.planning.data import LabelledSplit, load_split

OPTIONS = ("--planner.cost", "volume", "--planner.loss", "max_margin")


@pytest.fixture(scope="module")
def rival(tiny_run: TinyRun, tmp_path_factory: pytest.TempPathFactory) -> TinyRun:
    run = replace(tiny_run, folder=tmp_path_factory.mktemp("rival") / "run")
    said = command("shoot-train", *train_flags(run.root, run.templates, run.folder, 2, 2), *OPTIONS)
    assert said.status == 0, said.err
    return run


def opened(rival: TinyRun) -> tuple[TrainedRun, LabelledSplit]:
    run = open_run(rival.folder)
    with torch.no_grad():
        run.module.model.bev_encoder.head.weight *= 100.0  # a few steps leave scores almost equal
    return run, load_split(run.config.data, "val", run.templates)


def test_it_trains_a_map_for_each_waypoint(rival: TinyRun) -> None:
    run, split = opened(rival)
    assert run.config.planner.loss == "max_margin"
    head = run.module.model.bev_encoder.head
    assert head.out_channels == run.templates.points.shape[1] == 20
    batch = next(iter(batches(run, split, np.arange(3))))
    with torch.no_grad():
        maps = run.module.cost_maps(batch.sensors)
        loss = run.task.loss(run.module.planner, maps, batch)
        torch.testing.assert_close(loss, run.module.planner.margin_loss(maps, batch.future))
        assert loss != run.module.planner.loss(run.module(batch.sensors), batch.template_idx)


def test_evaluated_and_drawn(rival: TinyRun, tmp_path: Path) -> None:
    said = evaluate(rival)
    assert said.status == 0, said.err
    assert "blind" in (rival.folder / "report.json").read_text()
    said = command("shoot-render", rival.folder, "--out", tmp_path, "--num", 1)
    assert said.status == 0, said.err
    assert len(list(tmp_path.glob("*.png"))) == 1


def test_the_picture_shows_the_mean_over_times_and_says_so(
    rival: TinyRun, tiny_run: TinyRun
) -> None:
    run, split = opened(rival)
    view = view_sample(run, split, 1)
    assert view.caption.endswith("; the map: mean cost of 20 times")
    (batch,) = batches(run, split, np.asarray([1]))
    with torch.no_grad():
        maps = run.module.cost_maps(batch.sensors)[0].numpy()
    assert maps.std(axis=0).max() > 1e-3
    np.testing.assert_allclose(view.cost_map, maps.mean(axis=0), rtol=1e-4, atol=1e-5)
    assert "map" not in view_sample(open_run(tiny_run.folder), split, 1).caption


def test_the_fast_planner_gives_the_same_scores(
    rival: TinyRun, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(fast, "fastest_precision", lambda _: "32-true")
    run, split = opened(rival)
    sensors = next(iter(batches(run, split, np.arange(3)))).sensors
    with torch.no_grad():
        expected = run.module(sensors)
    assert expected.std() > 0.1
    scores = FastPlanner(run.module, compiled=False)(sensors)
    torch.testing.assert_close(scores, expected, rtol=1e-4, atol=1e-4)


def test_its_depth_can_be_studied(rival: TinyRun) -> None:
    run, split = opened(rival)
    study = study_depth(run, split, num_samples=2)
    assert study.nll["own"].value != study.nll["flat"].value


def test_weights_of_a_volume_are_refused_as_those_of_a_map(rival: TinyRun, tmp_path: Path) -> None:
    folder = tmp_path / "run"
    folder.mkdir()
    for file in rival.folder.iterdir():
        if file.is_file():
            (folder / file.name).write_bytes(file.read_bytes())
    config = folder / "config.yaml"
    config.write_text(config.read_text().replace("cost: volume", "cost: map"))
    said = command("shoot-evaluate", folder, "--out", tmp_path / "report.json")
    assert "do not fit its config.yaml" in complaint(said)
