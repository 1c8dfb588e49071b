"""A run knows where it came from: its baselines go with it, and scenes it has seen are no test."""

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from world_fixture import (
    NUM_TEMPLATES,
    SAMPLES_A_SCENE,
    TRAIN_RIDES,
    VAL_RIDES,
    TinyRun,
    command,
    copy_run,
    train_flags,
    write_rides,
)

from lss_core.errors import DataError
from shoot.baselines import kept_past_motion
from shoot.prediction.run import open_run
from shoot.templates import TemplateSet
from shoot.training.planning.data import load_split
from shoot.training.planning.motion import TrainingMotion
from shoot.training.planning.run_folder import PlanningRun


def evaluate(run: Path, out: Path, *flags: object) -> dict[str, Any]:
    said = command("shoot-evaluate", run, "--out", out, *flags)
    assert said.status == 0, said.err
    report: dict[str, Any] = json.loads(out.read_text())
    return report


def test_baselines_go_with_the_run_to_data_without_training_scenes(
    tiny_run: TinyRun, tmp_path: Path
) -> None:
    # The same drives in a data set that has no others: for who sees no image nothing may change.
    other = write_rides(tmp_path / "other", VAL_RIDES)
    expected = evaluate(tiny_run.folder, tmp_path / "own.json")["methods"]
    found = evaluate(tiny_run.folder, tmp_path / "other.json", "--data.root", other)["methods"]
    baselines = expected.keys() - {"model", "model_knowing_speed"}
    assert len(baselines) >= 7
    for name in baselines:
        assert found[name] == expected[name], name


def test_baselines_are_those_of_the_training_data_not_of_the_data_scored(
    tiny_run: TinyRun, tmp_path: Path
) -> None:
    # Training scenes of another kind in the other data set: they play no part.
    other = write_rides(tmp_path / "other", (*TRAIN_RIDES[:1], *VAL_RIDES))
    expected = evaluate(tiny_run.folder, tmp_path / "own.json")
    report = evaluate(tiny_run.folder, tmp_path / "other.json", "--data.root", other)
    assert report["methods"]["prior"] == expected["methods"]["prior"]
    assert report["methods"]["past_motion"] == expected["methods"]["past_motion"]


def test_what_is_kept_is_the_past_and_the_labels_and_no_future(tiny_run: TinyRun) -> None:
    trained = open_run(tiny_run.folder)
    split = load_split(trained.config.data, "train", trained.templates)
    kept = TrainingMotion.load(trained.folder.motion_file, trained.templates)
    assert kept.past.xy_m.shape == (len(TRAIN_RIDES) * SAMPLES_A_SCENE, 0, 2)
    np.testing.assert_array_equal(kept.labels, split.labels)
    np.testing.assert_array_equal(kept.scene_token[kept.past.scene], split.scene_tokens)
    np.testing.assert_array_equal(kept.past.past_known, split.futures.past_known)
    for name in ("velocity_mps", "yaw_rate_radps", "past_xy_m"):
        ours, theirs = getattr(kept.past, name), getattr(split.futures, name)
        np.testing.assert_allclose(ours, theirs, rtol=1e-6, atol=1e-6, err_msg=name)


def _spoil(stored: dict[str, Any], how: str) -> None:
    if how == "labels":
        stored["labels"] = stored["labels"] + NUM_TEMPLATES
    elif how == "scene":
        stored["scene"] = stored["scene"] - 1
    elif how == "past_xy_m":
        stored["past_xy_m"] = stored["past_xy_m"][1:]
    elif how == "velocity_mps":
        stored["velocity_mps"] = stored["velocity_mps"] * np.nan
    else:
        del stored[how]


@pytest.mark.parametrize("how", ["labels", "scene", "past_xy_m", "velocity_mps", "scene_token"])
def test_a_file_that_does_not_fit_says_what_does_not(
    tiny_run: TinyRun, tmp_path: Path, how: str
) -> None:
    run = PlanningRun(tiny_run.folder)
    with np.load(run.motion_file) as archive:
        stored = dict(archive)
    _spoil(stored, how)
    path = tmp_path / "training_motion.npz"
    np.savez_compressed(path, **stored)
    with pytest.raises(DataError, match=how):
        TrainingMotion.load(path, run.templates())
    path.write_bytes(b"PK no archive")
    with pytest.raises(DataError, match="does not hold"):
        TrainingMotion.load(path, run.templates())


def test_a_run_without_it_says_how_to_get_it(tiny_run: TinyRun, tmp_path: Path) -> None:
    run = copy_run(tiny_run, tmp_path)
    expected = evaluate(run.folder, tmp_path / "before.json")
    (run.folder / "training_motion.npz").unlink()
    said = command("shoot-evaluate", run.folder, "--out", tmp_path / "report.json")
    assert said.status == 2
    assert "lacks training_motion.npz" in said.err
    assert "--resume" in said.err
    flags = train_flags(run.root, run.templates, run.folder, 4, 2)
    assert command("shoot-train", *flags, "--resume").status == 0
    assert evaluate(run.folder, tmp_path / "after.json") == expected


def test_templates_fitted_on_the_scenes_validated_on_are_refused(
    tiny_run: TinyRun, tmp_path: Path
) -> None:
    templates = tmp_path / "peeked.npz"
    said = command(
        "shoot-fit-templates", "--data.root", tiny_run.root, "--out", templates,
        "--k", NUM_TEMPLATES, "--split", "val",
    )  # fmt: skip
    assert said.status == 0, said.err
    assert len(set(TemplateSet.load(templates).scene_tokens)) == len(VAL_RIDES)
    out = tmp_path / "run"
    flags = train_flags(tiny_run.root, templates, out, 1, 1)
    said = command("shoot-train", *flags)
    assert said.status == 2
    assert "The templates were fitted on 3 of the scenes to be scored" in said.err
    assert not (out / "checkpoints" / "last.ckpt").exists()
    said = command("shoot-train", *flags, "--allow-seen-scenes")
    assert said.status == 0, said.err
    said = command("shoot-evaluate", out, "--out", tmp_path / "report.json")
    assert said.status == 2
    assert "The templates were fitted on 3 of the scenes to be scored" in said.err
    evaluate(out, tmp_path / "report.json", "--allow-seen-scenes")


def test_a_run_finds_its_data_from_any_folder(
    tiny_run: TinyRun, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tiny_run.root.parent)
    assert not Path(tiny_run.root.name).is_absolute()
    flags = train_flags(Path(tiny_run.root.name), tiny_run.templates, tmp_path / "run", 1, 1)
    assert command("shoot-train", *flags).status == 0
    monkeypatch.chdir(tmp_path)
    evaluate(Path("run"), tmp_path / "report.json")


def test_a_run_given_away_with_its_data_finds_it_beside_itself(
    tiny_run: TinyRun, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    given = tmp_path / "given"
    shutil.copytree(tiny_run.folder, given / "run")
    shutil.copytree(tiny_run.root, given / "data")
    config = given / "run" / "config.yaml"
    told = yaml.safe_load(config.read_text())
    told["data"]["root"] = "../data"
    config.write_text(yaml.safe_dump(told))
    moved = given.rename(tmp_path / "moved")
    monkeypatch.chdir(tmp_path)
    expected = evaluate(tiny_run.folder, tmp_path / "own.json")
    assert evaluate(moved / "run", tmp_path / "moved.json")["methods"] == expected["methods"]


def test_networks_of_past_motion_are_fitted_once_a_run(tiny_run: TinyRun, tmp_path: Path) -> None:
    run = copy_run(tiny_run, tmp_path)
    kept = PlanningRun(run.folder).past_motion_file
    kept.unlink(missing_ok=True)
    fitted = evaluate(run.folder, tmp_path / "first.json")
    written = kept.stat().st_mtime_ns
    assert evaluate(run.folder, tmp_path / "second.json") == fitted
    assert kept.stat().st_mtime_ns == written
    kept.write_bytes(kept.read_bytes()[:-40])
    assert evaluate(run.folder, tmp_path / "third.json") == fitted
    assert kept.stat().st_mtime_ns > written


def test_networks_kept_for_other_labels_are_not_taken(tiny_run: TinyRun, tmp_path: Path) -> None:
    run = PlanningRun(tiny_run.folder)
    known = TrainingMotion.load(run.motion_file, run.templates())
    points, path = run.templates().points, tmp_path / "past_motion.safetensors"
    split = load_split(run.config().data, "val", run.templates())
    one = kept_past_motion(path, known.past, known.labels, points)
    other = kept_past_motion(path, known.past, (known.labels + 1) % NUM_TEMPLATES, points)
    again = kept_past_motion(path, known.past, known.labels, points)
    said = [fit.log_prob(split.futures) for fit in (one, other, again)]
    assert not np.allclose(said[0], said[1])
    np.testing.assert_array_equal(said[0], said[2])
    loaded = kept_past_motion(path, known.past, known.labels, points)
    assert (loaded.epochs, loaded.held_out_nll) == (again.epochs, again.held_out_nll)
    np.testing.assert_array_equal(loaded.log_prob(split.futures), said[0])
    # Where nothing can be written, they are fitted all the same.
    unkept = kept_past_motion(path / "no folder", known.past, known.labels, points)
    np.testing.assert_array_equal(unkept.log_prob(split.futures), said[0])
