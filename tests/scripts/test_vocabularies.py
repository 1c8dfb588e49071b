"""Vocabularies side by side: measured once each, and the page holds what the records say."""

import importlib
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from world_fixture import SMALL_FLAGS, TinyRun

ROOT = Path(__file__).parents[2]
CARD = '{"train_scenes": 4, "val_scenes": 3, "seed": 0}'


@pytest.fixture
def scripts(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Finds a module of scripts/ by name."""
    monkeypatch.syspath_prepend(ROOT / "scripts")
    return importlib.import_module


@pytest.fixture
def folder(tiny_run: TinyRun, tmp_path: Path) -> Path:
    """A folder with the tiny data set where the script looks for one."""
    world = tmp_path / "runs" / "world"
    world.mkdir(parents=True)
    for path in tiny_run.root.iterdir():
        (world / path.name).symlink_to(path)
    if not (world / "world.json").exists():
        (world / "world.json").write_text(CARD)
    return world.parent


def marked(root: Path, names: list[str]) -> None:
    (root / "README.md").write_text("".join(f"<!-- {n} -->\n<!-- /{n} -->\n" for n in names))


def config(scripts: Any, folder: Path, root: Path, **more: Any) -> Any:
    config = scripts("vocabularies").VocabulariesConfig
    return config(folder, records=root / "records", pages=root, jobs=1, **more)


def test_each_vocabulary_is_measured_once(
    scripts: Any, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    script, coverage = scripts("vocabularies"), scripts("vocabulary_table.coverage")
    kinds = scripts("vocabulary_table.vocabularies")
    small = tuple(kinds.Vocabulary(method, 10) for method in kinds.METHODS)
    monkeypatch.setattr(script, "ALL", small)
    marked(tmp_path, list(script.all_tables([], [])))
    asked = config(scripts, folder, tmp_path, part=("coverage",))
    assert script.vocabularies(asked) == []
    files = sorted((tmp_path / "records" / "coverage").iterdir())
    assert [file.stem for file in files] == sorted(one.name for one in small)

    drives = coverage.read_drives(folder / "world")
    record = json.loads(files[0].read_text())
    assert (len(drives.fitted), len(drives.held_out), drives.scenes) == (84, 63, (4, 3))
    assert record["coverage"]["val"]["count"] == 63
    assert record["coverage"]["train"]["mean_m"] < record["coverage"]["val"]["max_m"]
    assert 0.0 <= record["feel"]["infeasible_percent"] <= record["feel"]["uncomfortable_percent"]
    page = (tmp_path / "README.md").read_text()
    assert f"| 10 | cover | {record['coverage']['val']['mean_m']:.2f} |" in page
    assert page.count("Not run yet.") == 2

    # A record that is there is taken for what it says, and the others are not made anew.
    record["coverage"]["val"]["mean_m"] = 123.0
    files[0].write_text(json.dumps(record))
    times = [file.stat().st_mtime_ns for file in files]
    script.vocabularies(asked)
    assert [file.stat().st_mtime_ns for file in files] == times
    assert "| 10 | cover | 123.00 |" in (tmp_path / "README.md").read_text()


def test_shares_of_paths_that_none_could_drive(scripts: Any) -> None:
    times_s = 0.25 * np.arange(1, 21)
    accelerations = np.array([0.0, 1.0, 3.0, 9.0])  # fine, fine, uncomfortable, infeasible
    paths = np.zeros((4, 20, 2))
    paths[:, :, 0] = 2.0 * times_s + 0.5 * accelerations[:, None] * times_s**2
    feel = scripts("vocabulary_table.coverage")._feel(paths)
    assert feel == {"infeasible_percent": 25.0, "uncomfortable_percent": 50.0}


def planned(method: str, k: int, nll: float) -> dict[str, Any]:
    def interval(value: float) -> dict[str, float]:
        return {"value": value, "low": value - 1.0, "high": value + 1.0}

    names = ("top1", "top5", "top10", "top20", "min_ade_10")
    return {
        "method": method, "k": k, "seed": 0, "world": {"train_scenes": 20}, "num_scenes": 10,
        "steps": 9, "batch_size": 8, "precision": "32-true", "processor": "a processor",
        "train_s": 60.0, "runs_side_by_side": 2,
        "methods": {"model": dict.fromkeys(names, interval(5.0)) | {"nll": interval(nll)}},
        "oracle": {"ade": interval(2.0)},
    }  # fmt: skip


def test_planners_stand_in_the_table_of_their_method_or_size(scripts: Any) -> None:
    records = [planned("kmeans", 250, 4.0), planned("cover", 1000, 5.0)]
    tables = scripts("vocabulary_table.page").all_tables([], records)
    assert "K-Means, 250: 0" in tables["vocabularies-sizes"]
    assert "cover" not in tables["vocabularies-sizes"]
    assert "K-Means" not in tables["vocabularies-methods"]
    less = 4.0 - math.log(250)
    assert f"| {less:.2f} [{less - 1:.2f}, {less + 1:.2f}] | 2.00" in tables["vocabularies-sizes"]


@pytest.mark.full
def test_a_planner_is_trained_on_a_vocabulary(
    scripts: Any, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    script, kinds = scripts("vocabularies"), scripts("vocabulary_table.vocabularies")
    monkeypatch.setattr(script, "TRAINED", (kinds.Vocabulary("cover", 10),))
    marked(tmp_path, list(script.all_tables([], [])))
    flags = (*SMALL_FLAGS, "--optim.steps", "2", "--val-every", "2")
    asked = config(scripts, folder, tmp_path, part=("planners",), only=("cover-10-0",), flags=flags)
    assert script.vocabularies(asked) == []
    record = json.loads((tmp_path / "records" / "planners" / "cover-10-0.json").read_text())
    assert (record["method"], record["k"], record["flags"]) == ("cover", 10, [])
    assert record["num_samples"] == 15


def test_the_page_holds_what_the_records_say(scripts: Any) -> None:
    queue, page = scripts("run_queue"), scripts("vocabulary_table.page")
    records = ROOT / "docs" / "results" / "vocabularies"
    coverage, planners = (queue.load_records(records / part) for part in ("coverage", "planners"))
    text = (ROOT / "docs" / "templates.md").read_text(encoding="utf-8")
    for name, made in page.all_tables(coverage, planners).items():
        assert f"<!-- {name} -->\n\n{made}\n\n<!-- /{name} -->" in text, name
