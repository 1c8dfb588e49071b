"""The queue of runs behind docs/results/, and the tables made of what they leave."""

import importlib
import json
import os
import re
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest
from world_fixture import SMALL_FLAGS, TinyRun, command

from lss_core.errors import DataError
from lss_core.files import sole_writer

ROOT = Path(__file__).parents[2]
FLAGS = (*SMALL_FLAGS, "--optim.steps", "2", "--val-every", "2")


@pytest.fixture
def table(monkeypatch: pytest.MonkeyPatch) -> Any:
    """The script's modules."""
    monkeypatch.syspath_prepend(ROOT / "scripts")

    class Modules:
        again = importlib.import_module("planning_table.again")
        cells = importlib.import_module("planning_table.cells")
        experiments = importlib.import_module("planning_table.experiments")
        page = importlib.import_module("planning_table.page")
        records = importlib.import_module("planning_table.records")
        queue = importlib.import_module("run_queue")
        work = importlib.import_module("planning_table.work")

    return Modules


@pytest.fixture
def place(table: Any, tiny_run: TinyRun, tmp_path: Path) -> Any:
    """A tiny data set and its templates where the queue looks for them."""
    folder = tmp_path / "runs"
    folder.mkdir()
    (folder / "world").symlink_to(tiny_run.root)
    (folder / "templates.npz").write_bytes(tiny_run.templates.read_bytes())
    card = folder / "world" / "world.json"
    if not card.exists():
        card.write_text('{"train_scenes": 4, "val_scenes": 3, "seed": 0}')
    return table.queue.Place(folder, tmp_path / "records")


def names_of_tables(table: Any) -> list[str]:
    return list(table.page.all_tables([]))


def marked_page(table: Any, root: Path, inside: str) -> Path:
    """A page with markers for every table."""
    marks = (
        f"<!-- table6-{n} -->\n{inside}\n<!-- /table6-{n} -->\n" for n in names_of_tables(table)
    )
    page = root / "README.md"
    page.write_text(f"Before\n{''.join(marks)}after\n")
    return page


@pytest.mark.full
def test_runs_are_trained_evaluated_compared_and_shipped(
    table: Any, monkeypatch: pytest.MonkeyPatch, place: Any, tmp_path: Path
) -> None:
    """With the two runs of frustum_study.py."""
    monkeypatch.syspath_prepend(ROOT / "scripts")
    study, ship = (importlib.import_module(name) for name in ("frustum_study", "ship_planner"))
    runs = [run for run in study.RUNS if run.seed == 0]
    assert table.work.run_all(runs, place, 1, FLAGS) == []
    records = [json.loads(place.record(run).read_text()) for run in runs]
    for run, record in zip(runs, records, strict=True):
        assert (record["name"], record["seed"], record["num_samples"]) == (run.name, 0, 15)
        assert record["train_s"] > 0.0
        assert (place.folder / run.name / "report.html").is_file()

    made = study.tables(study.load_records(place.records))
    lines = made["frustum"].splitlines()
    assert set(made["frustum-short"].splitlines()) < set(lines)
    rows = {line.split(" | ")[0]: line for line in lines if line.startswith("| ")}
    assert {"| `cell`: 0", "| `sampled`: 0", "| `sampled` minus `cell`", "| prior"} <= set(rows)
    cell, sampled = (record["methods"]["model"]["nll"]["value"] for record in records)
    said = rows["| `sampled` minus `cell`"].split(" | ")[4]
    assert float(said.split(" ")[0]) == pytest.approx(sampled - cell, abs=0.01)

    run, out = place.folder / "cell-0", tmp_path / "shipped"
    picture = tmp_path / "templates.png"
    picture.write_bytes(b"a picture")
    ship.ship(ship.ShipConfig(run, out, picture, "../runs/world"))
    assert not (out / "checkpoints").exists()
    assert (out / "scenes.json").read_bytes() == (run / "scenes.json").read_bytes()
    said_by = [
        command("shoot-evaluate", folder, "--out", tmp_path / f"{folder.name}.json")
        for folder in (run, out)
    ]
    assert [said.status for said in said_by] == [0, 0], said_by
    ours, theirs = (json.loads((tmp_path / f"{n}.json").read_text()) for n in (run.name, out.name))
    assert ours == theirs
    value = ours["methods"]["model"]["nll"]["value"]
    assert f"| {value:.2f} [" in (out / "README.md").read_text()


def test_a_record_alone_tells_that_a_run_is_done(table: Any, place: Any, tmp_path: Path) -> None:
    runs = [table.experiments.Experiment("camera", "small", seed) for seed in (0, 1)]
    made = json.loads((ROOT / "docs" / "results" / "camera-0.json").read_text())
    place.records.mkdir()
    for run, top10 in zip(runs, (50.0, 60.0), strict=True):
        made["methods"]["model"]["top10"]["value"] = top10
        place.record(run).write_text(json.dumps(made | {"name": run.name, "seed": run.seed}))
    assert table.work.run_all(runs, place, 1, FLAGS) == []
    assert not any((place.folder / run.name).exists() for run in runs)

    page = marked_page(table, tmp_path, "outdated words")
    table.page.write_tables(table.queue.load_records(place.records), tmp_path)
    text = page.read_text()
    assert text.startswith("Before\n")
    assert text.endswith("after\n")
    assert "outdated" not in text
    line = next(line for line in text.splitlines() if line.startswith("| **camera**"))
    cells = [cell.strip() for cell in line.split("|")]
    assert cells[3].startswith("55.0 (50.0 to 60.0) [")


@pytest.mark.full
def test_what_ends_the_queue_ends_its_runs_with_a_checkpoint(place: Any) -> None:
    code = (
        "import signal, sys\n"
        "from pathlib import Path\n"
        "signal.signal(signal.SIGTERM, lambda number, _: sys.exit(128 + number))\n"
        "from planning_table import work\n"
        "import run_queue\n"
        "folder, records, *flags = sys.argv[1:]\n"
        "runs = [run_queue.Experiment('camera', 'small', seed) for seed in (0, 1)]\n"
        "work.run_all(runs, run_queue.Place(Path(folder), Path(records)), 1, flags)\n"
    )
    flags = [*SMALL_FLAGS, "--optim.steps", "100000", "--val-every", "100000"]
    queue = subprocess.Popen(
        [sys.executable, "-c", code, place.folder, place.records, *flags],
        env={**os.environ, "PYTHONPATH": f"{ROOT / 'scripts'}:{ROOT}"},
    )
    run = place.folder / "camera-0"
    while not (run / "metrics.csv").exists():
        assert queue.poll() is None, "the queue has ended"
        time.sleep(0.1)
    queue.terminate()
    assert queue.wait(timeout=60.0) == 143
    assert (run / "checkpoints" / "last.ckpt").is_file()
    with sole_writer(run):  # nobody is left who writes into it
        pass
    assert not (place.folder / "camera-1").exists()


def test_a_failing_run_is_named_and_leaves_no_record(table: Any, place: Any) -> None:
    run = table.experiments.Experiment("camera", "small", 0, ("--train-split", "nowhere"))
    assert table.work.run_all([run], place, 1, FLAGS) == ["camera-0"]
    assert not place.record(run).exists()
    assert "nowhere" in (place.folder / "camera-0" / "train.log").read_text()


def test_pages_without_a_tables_markers_are_left_alone(table: Any, tmp_path: Path) -> None:
    page = marked_page(table, tmp_path, "as it was")
    text = page.read_text().replace("table6-speed", "table6-sped")
    page.write_text(text)
    with pytest.raises(DataError, match="<!-- table6-speed -->"):
        table.page.write_tables([], tmp_path)
    assert page.read_text() == text


def test_tables_without_runs_say_so(table: Any, tmp_path: Path) -> None:
    page = marked_page(table, tmp_path, "outdated words")
    table.page.write_tables([], tmp_path)
    assert page.read_text().count("No run of these is finished yet.") == len(names_of_tables(table))
    assert "outdated" not in page.read_text()


def test_planners_are_compared_scene_by_scene(table: Any) -> None:
    """Worked out by hand: the first scene weighs three times the second."""

    def run(top10: tuple[float, float]) -> dict[str, Any]:
        return {
            "by_scene": {
                "scene-0003": {"num_samples": 30, "top10": top10[0], "nll": 1.0},
                "scene-0012": {"num_samples": 10, "top10": top10[1], "nll": 1.0},
            }
        }

    ours, theirs = [run((50.0, 90.0)), run((60.0, 70.0))], [run((40.0, 70.0))]
    # Means over seeds 55 and 80, so 15 and 10 points more: (3 x 15 + 10) / 4.
    assert table.cells.paired(ours, theirs, "top10") == "+13.8 [+10.0, +15.0]"
    assert table.cells.paired(ours, theirs, "nll") == "+0.00 [+0.00, +0.00]"
    other = run((40.0, 70.0))
    other["by_scene"]["scene-0012"]["num_samples"] = 9
    assert table.cells.paired(ours, [other], "top10") == "-"


def test_scenes_of_one_log_are_drawn_together(table: Any) -> None:
    def run(top10: tuple[float, float, float], logs: str) -> dict[str, Any]:
        return {
            "by_scene": {
                f"scene-{log}{number}": {"num_samples": 10, "top10": value, "log": log}
                for number, (value, log) in enumerate(zip(top10, logs, strict=True))
            }
        }

    # By hand: alone, the first log gains 20 and 40 points, the second none.
    ours, theirs = run((60.0, 80.0, 50.0), "aab"), run((40.0, 40.0, 50.0), "aab")
    assert table.cells.paired([ours], [theirs], "top10") == "+20.0 [+0.0, +30.0]"
    ours, theirs = run((60.0, 80.0, 50.0), "aaa"), run((40.0, 40.0, 50.0), "aaa")
    assert table.cells.paired([ours], [theirs], "top10") == "+20.0"


def test_a_change_is_measured_from_the_mean_over_seeds(table: Any, tmp_path: Path) -> None:
    """Every scene alike, so by hand: 44 beside 50, 52 and 54."""
    one = table.queue.load_records(ROOT / "docs" / "results")
    names = ("camera-half-steps-0", "camera-0", "camera-1", "camera-2", "lidar10-0")
    records = [json.loads(json.dumps(next(r for r in one if r["name"] == n))) for n in names]
    for record, top10 in zip(records, (44.0, 50.0, 52.0, 54.0, 90.0), strict=True):
        scene = {"num_samples": 30, "top10": top10, "nll": 4.0}
        record["by_scene"] = {"scene-0003": scene, "scene-0012": scene}
    assert table.records.bases_of(records[0], records) == records[1:4]
    assert table.records.bases_of(records[1], records) == []
    page = marked_page(table, tmp_path, "")
    table.page.write_tables(records, tmp_path)
    rows = [line.split(" | ") for line in page.read_text().splitlines() if "half-steps" in line]
    assert [row[-2:] for row in rows] == [["-8.0 [-8.0, -8.0]", "+0.00 [+0.00, +0.00] |"]]


def test_the_rivals_have_a_table_of_their_own(table: Any) -> None:
    records = table.queue.load_records(ROOT / "docs" / "results")
    records = [r for r in records if r["planner"] not in ("camera-volume", "camera-margin")]
    assert table.page.all_tables(records)["rivals"] == ""
    changed = next(r for r in records if r["name"] == "camera-half-steps-0")
    rival = changed | {"planner": "camera-margin", "name": "camera-margin-0"}
    made, before = table.page.all_tables([*records, rival]), table.page.all_tables(records)
    assert made["changes"] == before["changes"]
    rows = [line.split(" | ") for line in made["rivals"].splitlines()[4:]]
    assert [row[0].split(" (")[0] for row in rows] == ["| `camera`", "| `camera-margin-0`"]
    (as_limit,) = (line for line in made["changes"].splitlines() if "`camera-half-steps-0`" in line)
    assert rows[1][1:] == as_limit.split(" | ")[1:]


def test_runs_made_twice_are_compared_as_far_as_both_are_there(table: Any) -> None:
    records = table.queue.load_records(ROOT / "docs" / "results")
    again = json.loads(json.dumps([r for r in records if r["planner"] != "lidar1"]))
    for record in again:
        for scene in record["by_scene"].values():
            scene["top10"] += 2.0
    made = table.again.again_tables(records, again)
    setting, planners, differences, limits = made.values()
    assert f"{len(again)} runs" in setting
    assert "the same" in setting
    rows = [line.split(" | ") for line in planners.splitlines()[2:]]
    assert [row[1] for row in rows] == 2 * ["first", "again", "again minus first"]
    assert [row[0] for row in rows[::3]] == ["| camera: 0, 1, 2", "| lidar, 10 scans: 0, 1, 2"]
    assert all(row[3] == "+2.0 [+2.0, +2.0]" for row in rows[2::3])
    assert all(row[5] == "+0.00 [+0.00, +0.00] |" for row in rows[2::3])
    lines = differences.splitlines()[2:]
    assert [line.split(" | ")[:2] for line in lines] == [["| lidar, 10 scans", "camera"]]
    for line in lines + limits.splitlines()[4:]:  # all differences are the same in both
        *_, top10, top10_again, nll, nll_again, _ = (cell.strip() for cell in line.split("|"))
        assert top10 == top10_again
        assert nll == nll_again
    assert len(limits.splitlines()) == 4 + sum(bool(record["flags"]) for record in records)
    assert set(table.again.again_tables(records, []).values()) == {""}


def test_the_pages_hold_what_the_records_say(
    table: Any, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Tables are made of the records in docs/results/ and of nothing else."""
    monkeypatch.syspath_prepend(ROOT / "scripts")
    study, marked = (importlib.import_module(name) for name in ("frustum_study", "marked_page"))
    pages = [ROOT / "README.md", *(ROOT / "docs").glob("**/*.md")]
    for page in pages:
        copy = tmp_path / page.relative_to(ROOT)
        copy.parent.mkdir(parents=True, exist_ok=True)
        copy.write_text(page.read_text(encoding="utf-8"), encoding="utf-8")
    folder = ROOT / "docs" / "results"
    records = [table.queue.load_records(part) for part in (folder, folder / "again")]
    table.page.write_tables(records[0], tmp_path, records[1])
    marked.fill_pages(tmp_path, study.tables(table.queue.load_records(folder / "frustum")))
    for page in pages:
        assert (tmp_path / page.relative_to(ROOT)).read_text() == page.read_text(), page.name


def test_names_of_runs_are_unique(table: Any) -> None:
    names = [experiment.name for experiment in table.experiments.ALL]
    assert len(set(names)) == len(names)
    assert all(re.fullmatch(r"[a-z0-9-]+", name) for name in names)
