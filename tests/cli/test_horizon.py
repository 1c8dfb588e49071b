"""Templates of another horizon and step, and of others: from the command line to every number."""

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from world_fixture import NUM_VAL_SCENES, TinyRun, command, complaint, train_flags

from shoot.templates import TemplateSet

# Of keyframes at 0 s ... 7 s, those at 0 s ... 3 s.
SAMPLES_WITH_4_S = 7
NUM_TEMPLATES = 12


@pytest.fixture(scope="module")
def other(tiny_run: TinyRun, tmp_path_factory: pytest.TempPathFactory) -> TinyRun:
    """A planner of 4 s at 10 Hz, trained on templates that went out and came in again."""
    folder = tmp_path_factory.mktemp("other")
    run = TinyRun(tiny_run.root, folder / "again.npz", folder / "run")
    vocabulary = folder / "vocabulary.npy"
    for said in (
        command(
            "shoot-fit-templates", "--data.root", run.root, "--horizon-s", 4, "--dt-s", 0.1,
            "--k", NUM_TEMPLATES, "--out", folder / "fitted.npz", "--export", vocabulary,
        ),
        command(
            "shoot-fit-templates", "--from", vocabulary, "--dt-s", 0.1, "--out", run.templates
        ),
        command("shoot-train", *train_flags(run.root, run.templates, run.folder, 2, 2)),
    ):  # fmt: skip
        assert said.status == 0, said.err
    return run


def test_out_and_in_again_are_equal_templates(other: TinyRun) -> None:
    fitted = TemplateSet.load(other.templates.with_name("fitted.npz"))
    again = TemplateSet.load(other.templates)
    assert (again.dt_s, again.horizon_s) == (0.1, 4.0)
    assert again.points.shape == (NUM_TEMPLATES, 40, 2)
    np.testing.assert_array_equal(again.points, fitted.points)
    assert again.sha256 == fitted.sha256
    assert fitted.card["starts"] == "every LIDAR_TOP sweep with 4 s of recorded future"
    assert again.card["vocabulary"]["file"] == "vocabulary.npy"
    assert again.scenes == ()
    assert not again.counts.any()
    assert Image.open(other.templates.with_suffix(".png")).size[0] > 100
    assert json.loads(other.templates.with_suffix(".json").read_text())["sha256"] == again.sha256


def test_a_planner_of_them_is_scored_at_the_times_there_are(other: TinyRun, tmp_path: Path) -> None:
    page = tmp_path / "page.html"
    said = command(
        "shoot-evaluate", other.folder, "--out", tmp_path / "report.json", "--html", page
    )
    assert said.status == 0, said.err
    report = json.loads((tmp_path / "report.json").read_text())
    assert report["num_samples"] == NUM_VAL_SCENES * SAMPLES_WITH_4_S
    for method in report["methods"].values():
        assert {key for key in method if key.startswith("l2")} == {
            f"l2_{how}_{moment}s" for how in ("at", "upto") for moment in (1, 2, 3)
        }
        assert all(interval["value"] is not None for interval in method.values())
    assert "of the next 4 s" in page.read_text()


def test_a_picture_of_it(other: TinyRun, tmp_path: Path) -> None:
    said = command("shoot-render", other.folder, "--num", 1, "--out", tmp_path)
    assert said.status == 0, said.err
    assert len(list(tmp_path.glob("*.png"))) == 1


def test_a_vocabulary_is_counted_on_a_data_set(other: TinyRun, tmp_path: Path) -> None:
    """Futures are those of the fit: each is counted for the template it is nearest to."""
    out = tmp_path / "counted.npz"
    said = command(
        "shoot-fit-templates", "--from", other.templates.with_name("vocabulary.npy"),
        "--dt-s", 0.1, "--data.root", other.root, "--out", out,
    )  # fmt: skip
    assert said.status == 0, said.err
    fitted = TemplateSet.load(other.templates.with_name("fitted.npz"))
    counted = TemplateSet.load(out)
    # Rounded to float32 in between, a future on the border may change sides.
    assert np.abs(counted.counts - fitted.counts).sum() <= 2
    assert counted.counts.sum() == counted.card["num_futures"] == fitted.card["num_futures"]
    assert counted.card["coverage"].keys() == {"train", "val"}
    # They were not fitted on these scenes.
    assert counted.scenes == ()


def test_what_does_not_fit_together_is_said(other: TinyRun, tmp_path: Path) -> None:
    vocabulary, out = other.templates.with_name("vocabulary.npy"), tmp_path / "t.npz"

    def said(*flags: object) -> str:
        return complaint(command("shoot-fit-templates", "--out", out, *flags))

    assert "dt_s is not given" in said("--from", vocabulary)
    assert "data.root is not given" in said("--k", 3)
    assert "40 points, at 0.2 s each 8 s in all" in said(
        "--from", vocabulary, "--dt-s", 0.2, "--horizon-s", 4
    )
    assert "whole number of steps" in said("--data.root", other.root, "--horizon-s", 4.1)
    assert "must end in .npy" in said(
        "--from", vocabulary, "--dt-s", 0.1, "--export", tmp_path / "v.npz"
    )
    assert "no vocabulary" in said("--from", tmp_path / "none.npy", "--dt-s", 0.1)
    assert not out.exists()


def test_futures_longer_than_the_recording_are_said(tiny_run: TinyRun, tmp_path: Path) -> None:
    templates = tmp_path / "long.npz"
    points = np.ones((2, 20, 2), dtype=np.float32)
    TemplateSet(points, 1.0, np.zeros(2, dtype=np.int64)).save(templates)
    run = train_flags(tiny_run.root, templates, tmp_path / "run", 2, 2)
    assert "whole future, of 20 s" in complaint(command("shoot-train", *run))
