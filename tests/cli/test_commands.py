"""The commands end to end: what they print, write and promise to scripts."""

import csv
import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image
from world_fixture import (
    FEW_STEPS,
    NUM_TEMPLATES,
    NUM_TRAIN_SCENES,
    NUM_VAL_SCENES,
    SAMPLES_A_SCENE,
    TinyRun,
    command,
    complaint,
    train_flags,
)

from shoot.baselines import kept_past_motion, past_motion
from shoot.cli import demo
from shoot.prediction.run import open_run
from shoot.templates import TemplateSet
from shoot.training.planning.config import TrainConfig
from shoot.training.planning.motion import TrainingMotion

NUM_VAL = NUM_VAL_SCENES * SAMPLES_A_SCENE


@pytest.fixture(scope="module")
def evaluated(tiny_run: TinyRun, tmp_path_factory: pytest.TempPathFactory) -> tuple[str, Path]:
    """What shoot-evaluate printed, and its report."""
    report = tmp_path_factory.mktemp("report") / "new" / "report.json"
    said = command("shoot-evaluate", tiny_run.folder, "--out", report)
    assert said.status == 0, said.err
    return said.out, report


def test_report_keeps_its_contract(evaluated: tuple[str, Path]) -> None:
    report = json.loads(evaluated[1].read_text())
    assert (report["split"], report["num_samples"], report["num_scenes"]) == (
        "val", NUM_VAL, NUM_VAL_SCENES,
    )  # fmt: skip
    others = [
        "prior", "speed_prior", "standing_still",
        "constant_velocity", "constant_velocity_with_prior",
        "constant_yaw_rate", "constant_yaw_rate_with_prior",
        "past_motion", "blind", "model_knowing_speed",
    ]  # fmt: skip
    assert list(report["methods"]) == ["model", *others]
    assert list(report["differences"]) == others
    for method in report["methods"].values():
        for name in ("top1", "top5", "top10", "top20", "nll"):
            interval = method[name]
            assert set(interval) == {"value", "low", "high"}
            assert interval["low"] <= interval["value"] <= interval["high"]
        assert 0.0 <= method["top5"]["value"] <= method["top10"]["value"] <= 100.0
    # The share of 15 samples, in per cent; no two templates are equally probable to the model.
    hits = report["methods"]["model"]["top10"]["value"] * NUM_VAL / 100.0
    assert hits == pytest.approx(round(hits))


def test_differences_are_model_minus_baseline(evaluated: tuple[str, Path]) -> None:
    report = json.loads(evaluated[1].read_text())
    model = report["methods"]["model"]
    for name, difference in report["differences"].items():
        baseline = report["methods"][name]
        for metric in ("top10", "nll"):
            expected = model[metric]["value"] - baseline[metric]["value"]
            assert difference[metric]["value"] == pytest.approx(expected)


def test_parts_of_the_report_add_up(evaluated: tuple[str, Path]) -> None:
    report = json.loads(evaluated[1].read_text())
    for parts in (report["by_manoeuvre"], report["by_condition"]):
        assert sum(part["num_samples"] for part in parts.values()) == NUM_VAL
        nll = sum(p["methods"]["model"]["nll"]["value"] * p["num_samples"] for p in parts.values())
        assert nll / NUM_VAL == pytest.approx(report["methods"]["model"]["nll"]["value"])
    assert report["by_condition"]["night rain"]["num_samples"] == SAMPLES_A_SCENE


def test_table_shows_what_the_report_holds(evaluated: tuple[str, Path]) -> None:
    printed, path = evaluated
    report = json.loads(path.read_text())
    for name in ("model", "prior", "blind"):
        line = next(line for line in printed.splitlines() if line.split()[:1] == [name])
        metrics = report["methods"][name]
        assert line.split()[1:] == [
            f"{metrics['top5']['value']:.1f}",
            f"{metrics['top10']['value']:.1f}",
            f"{metrics['top20']['value']:.1f}",
            f"{metrics['nll']['value']:.2f}",
        ]
    assert f"Report: {path}" in printed


def test_evaluating_twice_gives_the_same(
    tiny_run: TinyRun, evaluated: tuple[str, Path], tmp_path: Path
) -> None:
    again = tmp_path / "again.json"
    assert command("shoot-evaluate", tiny_run.folder, "--out", again).status == 0
    assert json.loads(again.read_text()) == json.loads(evaluated[1].read_text())


def test_another_split_and_the_best_checkpoint(tiny_run: TinyRun, tmp_path: Path) -> None:
    out = tmp_path / "train.json"
    arguments = (
        "shoot-evaluate", tiny_run.folder, "--split", "train", "--checkpoint", "best",
        "--templates", tiny_run.templates, "--out", out,
    )  # fmt: skip
    said = command(*arguments)
    assert said.status == 2
    assert "The run was trained on 4 of the scenes to be scored" in said.err
    assert "--allow-seen-scenes" in said.err
    assert not out.exists()
    said = command(*arguments, "--allow-seen-scenes")
    assert said.status == 0, said.err
    report = json.loads(out.read_text())
    assert report["num_samples"] == NUM_TRAIN_SCENES * SAMPLES_A_SCENE


def test_render_writes_one_picture_a_sample(tiny_run: TinyRun, tmp_path: Path) -> None:
    out = tmp_path / "pictures"
    said = command("shoot-render", tiny_run.folder, "--num", 2, "--lidar", "--out", out)
    assert said.status == 0, said.err
    pictures = sorted(out.iterdir())
    # The log, which says how much of the split is there, is on the same stream.
    printed = [word for word in said.out.split() if word.endswith(".png")]
    assert [str(picture) for picture in pictures] == sorted(printed)
    # Evenly spread: the first and the last of the split.
    assert [picture.stem for picture in pictures] == ["scene-0003-00", "scene-0013-04"]
    for picture in pictures:
        assert np.asarray(Image.open(picture)).std() > 10.0


def test_render_draws_the_sample_asked_for(tiny_run: TinyRun, tmp_path: Path) -> None:
    said = command("shoot-render", tiny_run.folder, "--token", "scene-0002-03", "--out", tmp_path)
    assert said.status == 0, said.err
    assert [path.name for path in tmp_path.iterdir()] == ["scene-0002-03.png"]


def test_fit_templates_writes_file_card_and_picture(tiny_run: TinyRun, tmp_path: Path) -> None:
    out = tmp_path / "sets" / "ten.npz"
    said = command("shoot-fit-templates", "--data.root", tiny_run.root, "--out", out, "--k", 10)
    assert said.status == 0, said.err
    # 7 s of sweeps every 0.1 s; those up to 2 s have five seconds of future.
    assert "Mined 84 starts in 4 scenes of 'train'; left out 200 without 5 s of future." in said.out
    templates = TemplateSet.load(out)
    assert templates.points.shape == (10, 20, 2)
    assert templates.counts.sum() == 84
    card = json.loads(out.with_suffix(".json").read_text())
    assert card["sha256"] == templates.sha256
    assert (card["k"], card["num_futures"], card["num_left_out"]) == (10, 84, 200)
    assert card["coverage"]["val"]["count"] == 63
    assert f"{card['coverage']['train']['mean_m']:.2f}" in said.out
    assert Image.open(out.with_suffix(".png")).size[0] > 500


def test_fit_templates_as_a_stream(tiny_run: TinyRun, tmp_path: Path) -> None:
    out = tmp_path / "ten.npz"
    said = command(
        "shoot-fit-templates", "--data.root", tiny_run.root, "--out", out, "--k", 10, "--stream"
    )
    assert said.status == 0, said.err
    assert "Mined 84 starts in 4 scenes of 'train'; left out 200 without 5 s of future." in said.out
    assert "Fitted as a stream" in said.out
    card = json.loads(out.with_suffix(".json").read_text())
    assert (card["k"], card["num_futures"], card["num_left_out"]) == (10, 84, 200)
    assert f"{100 * card['inertia_given_up_at_most']:.0f} %" in said.out


@pytest.mark.parametrize("method", ["farthest", "cover", "medoids", "factored"])
def test_fit_templates_by_another_method(method: str, tiny_run: TinyRun, tmp_path: Path) -> None:
    out = tmp_path / "ten.npz"
    fit = ("shoot-fit-templates", "--data.root", tiny_run.root, "--out", out, "--k", 10)
    said = command(*fit, "--method", method)
    assert said.status == 0, said.err
    card = json.loads(out.with_suffix(".json").read_text())
    assert (card["k"], card["seed"], card["num_futures"]) == (10, 0, 84)
    assert card["settings"]
    assert card["coverage"]["val"]["count"] == 63
    assert "only kmeans takes" in complaint(command(*fit, "--method", method, "--stream"))


@pytest.mark.trains
def test_run_folder_holds_what_it_promises(tiny_run: TinyRun) -> None:
    names = {path.name for path in tiny_run.folder.iterdir()}
    assert {
        "config.yaml", "environment.json", "templates.npz", "checkpoints", "metrics.csv",
        "tensorboard",
    } <= names  # fmt: skip
    checkpoints = {path.name for path in (tiny_run.folder / "checkpoints").iterdir()}
    assert checkpoints == {"last.ckpt", "best.ckpt"}
    with (tiny_run.folder / "metrics.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    validated = {int(row["step"]): float(row["val_nll"]) for row in rows if row["val_nll"]}
    assert list(validated) == [1, 3]
    # No better and no worse than guessing, so short a training.
    assert list(validated.values()) == pytest.approx([np.log(NUM_TEMPLATES)] * 2, abs=0.1)


def test_metrics_of_training_and_evaluation_agree(
    tiny_run: TinyRun, evaluated: tuple[str, Path]
) -> None:
    with (tiny_run.folder / "metrics.csv").open() as stream:
        last = list(csv.DictReader(stream))[-1]
    model = json.loads(evaluated[1].read_text())["methods"]["model"]
    assert float(last["val_nll"]) == pytest.approx(model["nll"]["value"], abs=1e-4)
    assert float(last["val_top10"]) == pytest.approx(model["top10"]["value"], abs=1e-4)


def test_last_round_may_be_shorter_and_counts(tiny_run: TinyRun, tmp_path: Path) -> None:
    out = tmp_path / "run"
    said = command("shoot-train", *train_flags(tiny_run.root, tiny_run.templates, out, 3, 2))
    assert said.status == 0, said.err
    with (out / "metrics.csv").open() as stream:
        validated = [int(row["step"]) for row in csv.DictReader(stream) if row["val_nll"]]
    assert validated == [1, 2]
    last = torch.load(out / "checkpoints" / "last.ckpt", weights_only=True)
    assert last["global_step"] == 3


@pytest.mark.slow
def test_demo_shows_the_shipped_planner_then_trains_beside_it_and_reuses_all(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    arguments = ["shoot-demo", "--out", str(tmp_path / "demo"), "--train-scenes", "2"]
    arguments += ["--val-scenes", "1", "--first-scenes", "1", "--k", "30", "--steps", "3"]
    monkeypatch.setattr("sys.argv", [*arguments, "--image-scale", "0.05", "--workers", "1"])
    monkeypatch.setattr(past_motion, "STEPS_AN_EPOCH", FEW_STEPS)
    demo.main()
    printed = capsys.readouterr().out
    assert printed.count("Split 'val':") == 2
    out = tmp_path / "demo"
    first, second = (json.loads((out / f"{n}.json").read_text()) for n in ("shipped", "trained"))
    # The shipped planner first, then both: the town is the same one.
    shipped = first["methods"]["model"]
    assert second["methods"]["shipped_planner"] == shipped
    assert second["methods"]["model"]["nll"]["value"] > shipped["nll"]["value"]
    assert second["differences"]["shipped_planner"]["nll"]["value"] > 0.0
    for name in ("shipped", "trained"):
        assert f"Picture: {out / name}.png" in printed
        assert Image.open(out / f"{name}.png").size[0] > 500
    made = {
        path: path.stat().st_mtime_ns
        for folder in (out / "towns", out / "world")
        for path in [*folder.rglob("*"), *out.glob("templates.*")]
        if path.is_file()
    }
    checkpoint = torch.load(out / "run" / "checkpoints" / "last.ckpt", weights_only=True)
    demo.main()
    assert capsys.readouterr().out.count("Split 'val':") == 2
    assert made == {path: path.stat().st_mtime_ns for path in made}
    again = torch.load(out / "run" / "checkpoints" / "last.ckpt", weights_only=True)
    assert again["global_step"] == checkpoint["global_step"] == 3
    assert json.loads((out / "trained.json").read_text()) == second


def test_the_shipped_planner_is_whole_and_its_own_templates_are_its_labels(tmp_path: Path) -> None:
    folder = demo.shipped_run()
    trained = open_run(folder)
    known = TrainingMotion.load(trained.folder.motion_file, trained.templates)
    kept = Path(shutil.copy(trained.folder.past_motion_file, tmp_path))
    written = kept.stat().st_mtime_ns
    kept_past_motion(kept, known.past, known.labels, trained.templates.points)
    assert kept.stat().st_mtime_ns == written, "its networks are not those of its data"
    assert len(known.labels) > 20_000
    assert set(trained.templates.scene_tokens) == set(known.scene_token.tolist())
    assert not Path(TrainConfig.load(folder / "config.yaml").data.root).is_absolute()
    card = (folder / "README.md").read_text()
    assert f"{trained.config.optim.steps:,} steps" in card
    assert "## What not for" in card
