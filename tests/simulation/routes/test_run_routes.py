"""Many routes: the same bytes however they came about, and a failure is a result, too."""

import json
import time
from pathlib import Path

import pytest
import torch
from world_fixture import TinyRun, command, complaint, copy_run, start_command

FLAGS = ("--duration-s", "4", "--seed", "7", "--image-scale", "0.05")


def simulate(log: Path, *arguments: object) -> None:
    """Run the command in another process, where types are not checked."""
    process = start_command("shoot-simulate", *arguments, *FLAGS, log=log)
    process.join()
    assert process.exitcode == 0, log.read_text()


def results(folder: Path) -> dict[str, bytes]:
    files = [*(folder / "routes").iterdir(), folder / "settings.json", folder / "summary.json"]
    return {path.name: path.read_bytes() for path in files}


@pytest.fixture(scope="module")
def straight_on(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three routes in two towns."""
    folder = tmp_path_factory.mktemp("straight") / "on"
    flags = ("--driver", "constant_velocity", "--routes", 3, "--workers", 1, "--out", folder)
    simulate(folder.parent / "log", *flags)
    return folder


@pytest.mark.full
def test_two_workers_write_what_one_does(straight_on: Path, tmp_path: Path) -> None:
    flags = ("--driver", "constant_velocity", "--routes", 3, "--workers", 2)
    simulate(tmp_path / "log", *flags, "--out", tmp_path / "out")
    assert results(tmp_path / "out") == results(straight_on)


def test_a_planner_of_images_drives_the_same_way_twice(tiny_run: TinyRun, tmp_path: Path) -> None:
    for name in ("a", "b"):
        out = tmp_path / name
        flags = (tiny_run.folder, "--routes", 1, "--workers", 1, "--out", out)
        simulate(tmp_path / "log", *flags)
    assert results(tmp_path / "a") == results(tmp_path / "b")
    row = json.loads((tmp_path / "a" / "routes" / "route-0000.json").read_text())
    assert row["error"] is None
    assert len(row["plans"]["template"]) == 4
    assert None not in row["plans"]["template"]


def test_a_run_that_was_killed_goes_on(straight_on: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    flags = ("--driver", "constant_velocity", "--routes", 3, "--workers", 1, "--out", out)
    process = start_command("shoot-simulate", *flags, *FLAGS, log=tmp_path / "log")
    first = out / "routes" / "route-0000.json"
    while not first.exists():
        assert process.is_alive(), (tmp_path / "log").read_text()
        time.sleep(0.02)
    process.kill()
    process.join()
    assert not (out / "summary.json").exists()
    written = first.stat().st_mtime_ns
    simulate(tmp_path / "log", *flags)
    assert results(out) == results(straight_on)
    assert first.stat().st_mtime_ns == written


def test_more_routes_are_added_and_fewer_summed_up(straight_on: Path, tmp_path: Path) -> None:
    flags = ("--driver", "constant_velocity", "--workers", 1, "--out", tmp_path)
    simulate(tmp_path / "log", *flags, "--routes", 1)
    assert json.loads((tmp_path / "summary.json").read_text())["num_routes"] == 1
    simulate(tmp_path / "log", *flags, "--routes", 3)
    assert results(tmp_path) == results(straight_on)


def test_a_planner_without_finite_scores_counts_zero_and_is_listed(
    tiny_run: TinyRun, tmp_path: Path
) -> None:
    run = copy_run(tiny_run, tmp_path / "copy")
    last = run.folder / "checkpoints" / "last.ckpt"
    state = torch.load(last, weights_only=True)
    for name, value in state["state_dict"].items():
        if name.startswith("model.") and value.is_floating_point():
            value.fill_(float("nan"))
    torch.save(state, last)
    out = tmp_path / "out"
    simulate(tmp_path / "log", run.folder, "--routes", 1, "--workers", 1, "--out", out)
    summary = json.loads((out / "summary.json").read_text())
    assert summary["driving_score"]["value"] == 0.0
    assert {one["value"] for one in summary["sub_scores"].values()} == {0.0}
    (sentence,) = summary["failures"].values()
    assert "no finite scores" in sentence
    assert str(tmp_path) not in sentence
    assert f"Route 0 failed and counts 0: {sentence}" in (tmp_path / "log").read_text()


def test_results_of_other_settings_are_not_mixed(straight_on: Path, tmp_path: Path) -> None:
    flags = ("--driver", "constant_velocity", "--out", straight_on, *FLAGS)
    said = complaint(command("shoot-simulate", *flags, "--mode", "replay"))
    assert "mode = reactive, now it is replay" in said
    (tmp_path / "routes").mkdir()
    said = complaint(command("shoot-simulate", "--driver", "still", "--out", tmp_path))
    assert str(tmp_path) in said


def test_drivers_that_need_a_run_say_so_and_so_do_those_that_need_none(tmp_path: Path) -> None:
    assert "run folder" in complaint(command("shoot-simulate", "--out", tmp_path))
    said = command("shoot-simulate", "some/run", "--driver", "still", "--out", tmp_path)
    assert "some/run" in complaint(said)
    said = command("shoot-simulate", tmp_path, "--out", tmp_path / "out")
    assert f"'{tmp_path}' is no run folder" in complaint(said)
    assert not (tmp_path / "out").exists()


def test_what_is_beside_must_hold_these_routes(straight_on: Path, tmp_path: Path) -> None:
    flags = ("--driver", "constant_velocity", "--routes", 3, "--out", straight_on, *FLAGS)
    said = complaint(command("shoot-simulate", *flags, "--beside", tmp_path))
    assert str(tmp_path) in said
    said = command("shoot-simulate", *flags, "--beside", straight_on)
    assert said.status == 0, said.err
    summary = json.loads((straight_on / "summary.json").read_text())
    (difference,) = summary["minus"].values()
    assert difference["num_routes"] == 3
    assert difference["driving_score"]["value"] == 0.0
    assert "minus" in said.out
