"""How a city is written: the same bytes however it is made, and nothing of others' touched."""

import hashlib
import json
import os
import signal
import sys
import time
from pathlib import Path

import pytest
from small_city import DURATION_S, config, start

from lss_core.data.splits import official_scenes
from lss_core.errors import DataError
from shoot.cli import make_world as command
from shoot.world.config import VERSION
from shoot.world.writer import make_world


def digest(root: Path) -> dict[str, str]:
    return {
        str(path.relative_to(root)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(root.rglob("*"))
        if path.is_file()
    }


def test_nothing_but_the_data_set_is_left(root: Path):
    assert sorted(path.name for path in root.iterdir()) == [
        "maps",
        "samples",
        VERSION,
        "world.json",
    ]


def test_a_scene_depends_on_its_number_only(root: Path, tmp_path: Path):
    assert start(tmp_path / "more", train_scenes=0, val_scenes=2).wait() == 0
    name = official_scenes(VERSION, "val")[0]
    ours, more = (
        {k: v for k, v in digest(folder).items() if name in k}
        for folder in (root, tmp_path / "more")
    )
    assert len(ours) > 10
    assert ours == more


def test_another_seed_gives_another_world(root: Path, mended: Path):
    ours, other = (
        json.loads((folder / VERSION / "ego_pose.json").read_text())[-1]["translation"]
        for folder in (root, mended)
    )
    assert ours != other


def test_killed_and_continued_by_two_workers_gives_the_same_bytes(root: Path, tmp_path: Path):
    out = tmp_path / "killed"
    parts = out / ".parts"
    job = start(out)
    first = parts / f"{official_scenes(VERSION, 'train')[0]}.json"
    deadline = time.monotonic() + 300
    while not first.exists() and job.poll() is None and time.monotonic() < deadline:
        time.sleep(0.02)
    os.kill(job.pid, signal.SIGKILL)
    job.wait()
    assert first.exists()
    assert not (out / VERSION).exists()
    finished = next(iter((out / "samples" / "CAM_FRONT").glob("*")))
    made_at = finished.stat().st_mtime_ns
    assert start(out, workers=2).wait() == 0
    assert finished.stat().st_mtime_ns == made_at, "a finished scene was made again"
    assert digest(out) == digest(root)


def test_finished_worlds_are_left_alone(root: Path):
    before = {path: path.stat().st_mtime_ns for path in root.rglob("*")}
    make_world(config(root))
    assert {path: path.stat().st_mtime_ns for path in root.rglob("*")} == before


@pytest.mark.parametrize(
    ("changes", "setting"),
    [
        ({"seed": 9}, "seed"),
        ({"image_scale": 0.1}, "image_scale"),
        ({"train_scenes": 1}, "train_scenes"),
    ],
)
def test_other_settings_in_the_same_folder_are_refused(root: Path, changes, setting):
    with pytest.raises(DataError, match=setting):
        make_world(config(root, **changes))


def test_strange_folders_are_refused(tmp_path: Path):
    (tmp_path / "real" / VERSION).mkdir(parents=True)
    with pytest.raises(DataError, match="another data set"):
        make_world(config(tmp_path / "real"))
    (tmp_path / "file").write_text("")
    with pytest.raises(DataError, match="is a file"):
        make_world(config(tmp_path / "file"))
    (tmp_path / "torn").mkdir()
    (tmp_path / "torn" / "world.json").write_text("{")
    with pytest.raises(DataError, match="cannot be read"):
        make_world(config(tmp_path / "torn"))


@pytest.mark.parametrize(
    ("changes", "setting"),
    [
        ({"train_scenes": 701}, "train_scenes"),
        ({"image_scale": 3.0}, "image_scale"),
        ({"train_scenes": 0, "val_scenes": 0}, "nothing to write"),
        ({"workers": 0}, "workers"),
        ({"tail_s": DURATION_S}, "tail_s"),
    ],
)
def test_impossible_settings_are_refused(tmp_path: Path, changes, setting):
    with pytest.raises(DataError, match=setting):
        config(tmp_path, **changes)


def test_the_command_reports_in_one_sentence(root: Path, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["shoot-make-world", str(root)])
    with pytest.raises(SystemExit) as stop:
        command.main()
    assert stop.value.code == 2
    said = capsys.readouterr().err
    assert said.startswith("error: ")
    assert said.count("\n") == 1
    assert "train_scenes = 2" in said
