"""Tables of segmentations and of robustness: made of records alone, and the pages hold them."""

import importlib
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from world_fixture import SMALL_FLAGS, TinyRun, TinySegmenter

ROOT = Path(__file__).parents[2]


@pytest.fixture
def scripts(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Finds a module of scripts/ by name."""
    monkeypatch.syspath_prepend(ROOT / "scripts")
    return importlib.import_module


def interval(value: float) -> dict[str, float]:
    return {"value": value, "low": value - 1.0, "high": value + 1.0}


def record(method: str, seed: int, car: float) -> dict[str, Any]:
    """Of ten scenes with cars that are found or not, as many for each class."""
    classes = ("car", "vehicle", "drivable", "lane_boundary")
    part = {"num_samples": 30, "num_scenes": 10, "classes": {"car": {"iou": interval(car)}}}
    found = round(10 * car)
    cells = {"true_positives": found, "false_positives": 0, "false_negatives": 1000 - found}
    return {
        "name": f"{method}-{seed}", "method": method, "seed": seed, "train_s": 600.0,
        "runs_side_by_side": 2, "processor": "a processor", "precision": "32-true",
        "world": {"train_scenes": 700}, "steps": 4000, "batch_size": 8, "grid": [100, 100],
        "task": "segmentation", "split": "val", "cell_m": 1.0, "num_samples": 30, "num_scenes": 10,
        "classes": {name: {"iou": interval(car)} for name in classes},
        "baselines": {"prior_map": {name: {"iou": interval(5.0)} for name in classes}},
        "by_distance": {"0-10 m": part}, "by_condition": {"day": part},
        "by_scene": {
            f"scene-{n:04d}": {"num_samples": 3, "classes": dict.fromkeys(classes, cells)}
            for n in range(10)
        },
    }  # fmt: skip


def test_tables_say_what_the_records_say(scripts: Any, tmp_path: Path) -> None:
    page, queue = scripts("segmentation_table.page"), scripts("run_queue")
    for made in (record("ours", 0, 30.0), record("ours", 1, 34.0), record("oft", 0, 25.0)):
        queue.save_record(made, tmp_path / f"{made['name']}.json")
    tables = page.all_tables(tmp_path, queue.load_records(tmp_path))
    rows = [line.split(" | ") for line in tables["table1"].splitlines()]
    ours = next(row for row in rows if row[0] == "| **Lift-Splat**")
    assert ours[1] == "32.00 (30.00 to 34.00) [29.00, 35.00]"
    assert ours[3].startswith("32.06")
    # Both halves of a difference are exact here: no scene differs from another.
    assert "| OFT | +7.00 [+7.00, +7.00]" in tables["paired"]
    assert "0-10 m" in tables["rings"]
    assert not any(page.all_tables(tmp_path, []).values())


def test_the_pages_hold_what_the_records_say(scripts: Any) -> None:
    queue = scripts("run_queue")
    results = ROOT / "docs" / "results"
    of_runs, asked = results / "segmentation", results / "robustness"
    seg, rob = scripts("segmentation_table.page"), scripts("robustness_table.page")
    tables = {
        f"segmentation-{name}": text or "No run of these is finished yet."
        for name, text in seg.all_tables(of_runs, queue.load_records(of_runs)).items()
    } | {
        f"robustness-{name}": text or "No run of these is finished yet."
        for name, text in rob.all_tables(asked).items()
    }
    away = scripts("transfer").all_tables(results / "transfer", of_runs)
    tables |= {name: text or "No run of these is finished yet." for name, text in away.items()}
    pages = "\n".join(page.read_text(encoding="utf-8") for page in results.glob("*.md"))
    for name, text in tables.items():
        assert f"<!-- {name} -->\n\n{text}\n\n<!-- /{name} -->" in pages, name


def test_every_run_is_named_once(scripts: Any) -> None:
    runs = scripts("segmentation_table.experiments").ALL
    assert len({run.name for run in runs}) == len(runs) == 19
    conditions = scripts("robustness_table.conditions")
    for task in ("segmentation", "planning"):
        for trained in conditions.runs_of(task):
            names = [condition.name for condition in conditions.conditions_of(trained)]
            assert len(set(names)) == len(names) > 1


def test_runs_are_asked_under_conditions(
    scripts: Any, tiny_segmenter: TinySegmenter, tiny_run: TinyRun
) -> None:
    asking, conditions = scripts("robustness_table.asking"), scripts("robustness_table.conditions")
    blind = conditions.Condition("dark", conditions.Disturbance(missing=conditions.CAMERAS[:5]))
    found = asking.ask("segmentation", tiny_segmenter.folder, blind, 1)
    assert {"car", "drivable"} <= found["scores"].keys()
    plain = conditions.Condition("plain", cameras=("CAM_FRONT", "CAM_BACK"))
    asked = asking.ask("planning", tiny_run.folder, plain, 2)
    assert set(asked["scores"]) == {"top10", "nll"}
    in_scenes = asked["by_scene"].values()
    mean = np.average(
        [s["top10"] for s in in_scenes], weights=[s["num_samples"] for s in in_scenes]
    )
    assert asked["scores"]["top10"]["value"] == pytest.approx(mean)


def ask_all(scripts: Any, folder: Path) -> list[dict[str, Any]]:
    """A record of every run, and of every run under every condition: 10 % better than `plain`."""
    conditions, queue = scripts("robustness_table.conditions"), scripts("run_queue")
    asked_file = scripts("robustness_table.paired").asked_file
    records = []
    for task in ("segmentation", "planning"):
        for run in conditions.runs_of(task):
            value = 40.0 if run == conditions.PLAIN else 50.0
            made = record(run, 0, value)
            queue.save_record(made, folder / "runs" / task / f"{run}-0.json")
            cells = made["by_scene"]["scene-0000"]["classes"]["car"]
            in_scene = {"num_samples": 3, "classes": {"car": cells}, "top10": value, "nll": value}
            for condition in conditions.conditions_of(run):
                records.append({
                    "task": task, "run": run, "condition": condition.name, "split": "val",
                    "scores": {name: interval(value) for name in ("car", "top10", "nll")},
                    "by_scene": {f"scene-{n:04d}": in_scene for n in range(10)},
                })  # fmt: skip
                file = asked_file(folder, task, run, condition.name)
                queue.save_record(records[-1], file)
    return records


def test_robustness_has_every_cell_and_picture_of_its_records(scripts: Any, tmp_path: Path) -> None:
    records = ask_all(scripts, tmp_path / "records")
    tables = scripts("robustness_table.page").all_tables(tmp_path / "records")
    assert all("| - |" not in table for table in tables.values())
    assert tables["setting-planning"].startswith("700 training scenes, 10 validation scenes; 4000")
    for kind in ("noise", "drop"):
        assert "minus plain | +10.00 [+10.00, +10.00]" in tables[f"{kind}-segmentation"]
        assert "minus plain | +10.0 [+10.0, +10.0]" in tables[f"{kind}-planning-top10"]
    new = tables["new-segmentation"].splitlines()
    assert new[2] == "| 4 cameras | 50.00 [49.00, 51.00] |  |"
    assert new[-1] == "| all cameras | 50.00 [49.00, 51.00] | +0.00 [+0.00, +0.00] |"
    curves, rig = scripts("robustness_table.curves_figure"), scripts("robustness_table.rig_figure")
    for draw, part in ((curves.draw_curves, records), (rig.draw_rig, records)):
        path = tmp_path / f"{draw.__name__}.png"
        assert not draw([], path)
        assert not path.exists()
        assert draw(part, path)
        assert path.stat().st_size > 10_000
    # Without one of its cameras' records no rig is drawn.
    assert not rig.draw_rig([r for r in records if r["condition"] != "without-CAM_BACK"], path)


def test_one_moment_is_drawn_without_each_camera(
    scripts: Any, tiny_segmenter: TinySegmenter, tmp_path: Path
) -> None:
    path = tmp_path / "missing.png"
    scripts("robustness_table.missing_figure").draw_missing(tiny_segmenter.folder, path)
    assert path.stat().st_size > 10_000


def test_a_run_is_asked_with_another_rig(
    scripts: Any, tiny_segmenter: TinySegmenter, tmp_path: Path
) -> None:
    """Here its own; of the towns of both there is one table."""
    transfer, save = scripts("transfer"), scripts("run_queue").save_record
    asked = transfer.ask(tiny_segmenter.folder, tiny_segmenter.root, "ours", 0)
    save(asked, tmp_path / "ours-0.json")
    save(asked | {"name": "oft-0", "method": "oft"}, tmp_path / "oft-0.json")
    save(record("ours", 0, 30.0), tmp_path / "at_home" / "ours-0.json")
    tables = transfer.all_tables(tmp_path, tmp_path / "at_home")
    assert "| **Lift-Splat** | 30.00 [29.00, 31.00] |" in tables["transfer-table4"]
    assert "| 21.35 | 22.59 |" in tables["transfer-table4"]
    assert "| OFT | +0.00" in tables["transfer-paired"]
    assert tables["transfer-setting"].startswith("700 training scenes")


@pytest.mark.full
def test_a_run_is_trained_evaluated_and_recorded(
    scripts: Any, tiny_segmenter: TinySegmenter, tmp_path: Path
) -> None:
    queue = scripts("run_queue")
    records = scripts("segmentation_table.records")
    (tmp_path / "world").symlink_to(tiny_segmenter.root)
    place = queue.Place(tmp_path, tmp_path / "records", "segmentation")
    run = queue.Experiment("uniform", "segment", 0, ("--model.lift", "uniform"))
    flags = (*SMALL_FLAGS, "--optim.steps", "2", "--val-every", "2")
    assert queue.run_all([run], place, records.SEGMENTATIONS, 1, flags) == []
    kept = json.loads(place.record(run).read_text())
    assert (kept["method"], kept["task"]) == ("uniform", "segmentation")
    assert set(kept["classes"]) == {"car", "vehicle", "drivable", "lane_boundary"}
    tables = scripts("segmentation_table.page").all_tables(place.records, [kept])
    assert "| uniform depth |" in tables["table1"]
