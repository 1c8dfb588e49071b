"""shoot-export: what it writes, and what it refuses in one sentence."""

import json
import sys
from pathlib import Path

import pytest
from exported_run import export_tiny
from world_fixture import TinyRun, command, complaint

from shoot.export.int8 import run_file
from shoot.export.numpy_inputs import __file__ as helper
from shoot.export.samples import inputs_of
from shoot.templates import TemplateSet
from shoot.training.segmentation.config import SegmentConfig


def test_all_files_stand_beside_each_other(tiny_run: TinyRun, tmp_path: Path) -> None:
    pytest.importorskip("onnx")
    out = tmp_path / "out"
    said = command(
        "shoot-export", tiny_run.folder, "--onnx", out / "a.onnx", "--program", out / "b.pt2",
        "--int8", 4,
    )  # fmt: skip
    assert said.status == 0, said.err
    assert "On 4 validation samples" in said.out
    assert {file.name for file in out.iterdir()} == {
        "a.onnx", "a-int8.onnx", "a.json", "a-templates.npz", "b.pt2", "b.json",
        "b-templates.npz", "numpy_inputs.py",
    }  # fmt: skip
    assert (out / "numpy_inputs.py").read_bytes() == Path(helper).read_bytes()
    card = json.loads((out / "a.json").read_text())
    templates = TemplateSet.load(out / "a-templates.npz")
    assert card["templates"]["sha256"] == templates.sha256
    exported = export_tiny(tiny_run)
    assert card == exported.card
    prob = run_file(out / "a.onnx", [inputs_of(card, exported.sensors, 0)])
    assert prob.shape == (1, len(templates.points))
    assert prob.sum() == pytest.approx(1.0, abs=1e-5)


def test_something_must_be_asked_for(tiny_run: TinyRun, tmp_path: Path) -> None:
    assert "name a file with --onnx" in complaint(command("shoot-export", tiny_run.folder))
    flags = ("--program", tmp_path / "a.pt2", "--int8", 4)
    said = command("shoot-export", tiny_run.folder, *flags)
    assert "--int8 goes with an ONNX file" in complaint(said)
    assert not list(tmp_path.iterdir())


def test_other_runs_are_refused(tiny_run: TinyRun, tmp_path: Path) -> None:
    out = tmp_path / "a.pt2"
    SegmentConfig(out=str(tmp_path / "maps")).save(tmp_path / "maps" / "config.yaml")
    said = command("shoot-export", tmp_path / "maps", "--program", out)
    assert "is a segmentation, and only planners can be exported" in complaint(said)
    said = command("shoot-export", tmp_path / "nothing", "--program", out)
    assert "nothing" in complaint(said)
    assert not out.exists()


def test_data_that_is_not_there_is_missed_before_the_work(
    tiny_run: TinyRun, tmp_path: Path
) -> None:
    pytest.importorskip("onnx")
    flags = ("--onnx", tmp_path / "a.onnx", "--int8", 4, "--data.root", tmp_path / "away")
    assert "away" in complaint(command("shoot-export", tiny_run.folder, *flags))
    assert not (tmp_path / "a.onnx").exists()


def test_missing_packages_are_named(
    tiny_run: TinyRun, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("onnx")
    monkeypatch.setitem(sys.modules, "onnxruntime", None)
    said = command("shoot-export", tiny_run.folder, "--onnx", tmp_path / "a.onnx")
    assert (
        "needs onnxruntime, which is not installed: pip install 'shoot-planner[export]'"
        in complaint(said)
    )
