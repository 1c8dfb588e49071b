"""A run remembers which scenes it has seen, by what was driven in them: names may change."""

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from driving_world import WIDE_ROAD, write_road
from tiny_tables import VERSION, TinyScene, read_table, write_table
from world_fixture import (
    NUM_TEMPLATES,
    TRAIN_RIDES,
    VAL_RIDES,
    TinyRun,
    command,
    copy_run,
    train_flags,
    write_rides,
)

from lss_core.data.drives import KnownScene
from lss_core.errors import DataError
from lss_core.files import check_writable
from shoot.templates import TemplateSet
from shoot.training.planning.run_folder import PlanningRun
from shoot.training.run_scenes import RunScenes

RENAMED = tuple(replace(ride, name=f"scene-{14 + i:04d}") for i, ride in enumerate(TRAIN_RIDES))


def write_splits(root: Path, **splits: Sequence[TinyScene]) -> None:
    named = {split: [scene.name for scene in scenes] for split, scenes in splits.items()}
    (root / VERSION / "splits.json").write_text(json.dumps(named))


def refused(name: str, *arguments: object) -> str:
    said = command(name, *arguments)
    assert said.status == 2, said.out
    (line,) = (line for line in said.err.splitlines() if line.startswith("error: "))
    assert "Traceback" not in said.err
    return line


def resume_flags(run: TinyRun) -> list[str]:
    return [*train_flags(run.root, run.templates, run.folder, 4, 2), "--resume"]


@pytest.fixture
def copy(tiny_run: TinyRun, tmp_path: Path) -> TinyRun:
    return copy_run(tiny_run, tmp_path / "copy")


def test_a_run_keeps_its_scenes(tiny_run: TinyRun, tmp_path: Path) -> None:
    kept = RunScenes.load(PlanningRun(tiny_run.folder).scenes_file)
    assert kept is not None
    assert [scene.name for scene in kept.trained] == [ride.name for ride in TRAIN_RIDES]
    assert [scene.name for scene in kept.validated] == [ride.name for ride in VAL_RIDES]
    assert kept.fitted == kept.trained == TemplateSet.load(tiny_run.templates).scenes
    digests = [scene.digest for scene in (*kept.trained, *kept.validated)]
    assert len(set(digests)) == len(TRAIN_RIDES) + len(VAL_RIDES)
    kept.save(tmp_path / "scenes.json")
    assert RunScenes.load(tmp_path / "scenes.json") == kept


def test_splits_changed_after_training(copy: TinyRun, tmp_path: Path) -> None:
    # The second training scene is now one to validate on, and the other way round.
    train, val = (TRAIN_RIDES[0], *TRAIN_RIDES[2:], VAL_RIDES[0]), (TRAIN_RIDES[1], *VAL_RIDES[1:])
    write_splits(copy.root, train=train, val=val)
    out = tmp_path / "report.json"
    said = refused("shoot-evaluate", copy.folder, "--out", out)
    assert "The run was trained on 1 of the scenes to be scored ('scene-0002' is one)" in said
    # Templates are another matter, which comes first.
    said = refused("shoot-train", *resume_flags(copy), "--allow-seen-scenes")
    assert (
        "was begun with other training scenes: 1 are new ('scene-0003' is one), 1 are gone "
        "('scene-0002' is one)"
    ) in said
    write_splits(copy.root, train=TRAIN_RIDES, val=VAL_RIDES[1:])
    said = refused("shoot-train", *resume_flags(copy))
    assert "was begun with other validation scenes: 1 are gone ('scene-0003' is one)" in said
    write_splits(copy.root, train=TRAIN_RIDES, val=VAL_RIDES)
    assert command("shoot-train", *resume_flags(copy)).status == 0


def test_a_copy_of_training_scenes_under_other_names(tiny_run: TinyRun, tmp_path: Path) -> None:
    # Other names and tokens, other times.
    other = write_rides(tmp_path / "other", (*VAL_RIDES[:1], *RENAMED[:2]))
    out = tmp_path / "report.json"
    arguments = ("shoot-evaluate", tiny_run.folder, "--out", out, "--data.root", other)
    said = refused(*arguments)
    assert "The run was trained on 2 of the scenes to be scored" in said
    assert "'scene-0014' is one, by its poses 'scene-0001'" in said
    assert not out.exists()
    told = command(*arguments, "--allow-seen-scenes")
    assert told.status == 0, told.err
    assert "2 SEEN in training" in " ".join(told.out.split())
    report: dict[str, Any] = json.loads(out.read_text())
    assert (report["num_scenes"], report["num_seen_scenes"]) == (3, 2)


def test_one_drive_under_two_names_in_training_and_validation(
    tiny_run: TinyRun, tmp_path: Path
) -> None:
    root = write_rides(tmp_path / "data", (*TRAIN_RIDES, VAL_RIDES[0], RENAMED[2]))
    out = tmp_path / "run"
    flags = train_flags(root, tiny_run.templates, out, 1, 1)
    for more in ([], ["--allow-seen-scenes"]):
        said = refused("shoot-train", *flags, *more)
        assert "Scene 'scene-0016' of split 'val' and scene 'scene-0004' of split 'train'" in said
    assert not (out / "checkpoints" / "last.ckpt").exists()
    said = refused(
        "shoot-fit-templates", "--data.root", root, "--out", tmp_path / "t.npz", "--k", 8
    )
    assert "Scene 'scene-0016' of split 'val' and scene 'scene-0004' of split 'train'" in said
    assert not (tmp_path / "t.npz").exists()


def test_templates_fitted_on_a_copy_of_what_is_validated_on(
    tiny_run: TinyRun, tmp_path: Path
) -> None:
    renamed = [replace(ride, name=f"scene-{1 + row:04d}") for row, ride in enumerate(VAL_RIDES[1:])]
    copied = write_rides(tmp_path / "data", [replace(VAL_RIDES[0], name="scene-0005"), *renamed])
    templates = tmp_path / "peeked.npz"
    said = command(
        "shoot-fit-templates", "--data.root", copied, "--out", templates, "--k", NUM_TEMPLATES
    )
    assert said.status == 0, said.err
    flags = train_flags(tiny_run.root, templates, tmp_path / "run", 1, 1)
    told = refused("shoot-train", *flags)
    assert "The templates were fitted on 3 of the scenes to be scored" in told
    assert "('scene-0003' is one, by its poses 'scene-0005')" in told
    assert command("shoot-train", *flags, "--allow-seen-scenes").status == 0


def test_a_run_from_before_is_compared_by_token(copy: TinyRun, tmp_path: Path) -> None:
    PlanningRun(copy.folder).scenes_file.unlink()
    said = command("shoot-evaluate", copy.folder, "--out", tmp_path / "report.json")
    assert said.status == 0, said.err
    assert "has no scenes.json" in " ".join((said.out + said.err).split())
    write_splits(copy.root, train=(*TRAIN_RIDES[:3], VAL_RIDES[0]), val=VAL_RIDES[1:])
    told = refused("shoot-train", *resume_flags(copy))
    assert "other training scenes: 1 are new ('scene-0003' is one), 1 are gone ('token" in told
    assert not PlanningRun(copy.folder).scenes_file.exists()
    write_splits(copy.root, train=TRAIN_RIDES, val=VAL_RIDES)
    assert command("shoot-train", *resume_flags(copy)).status == 0
    assert PlanningRun(copy.folder).scenes_file.exists()


@pytest.mark.parametrize(
    "text",
    [
        "",
        "[]",
        '{"format_version": 2, "scenes": []}',
        '{"format_version": 1, "scenes": [{"name": "a", "token": "b", "digest": "c"}]}',
        '{"format_version": 1, "scenes": [{"name":"a","token":"b","digest":"c","used_for":[]}]}',
        "[" * 100_000,
    ],
)
def test_what_is_no_list_of_scenes(tmp_path: Path, text: str) -> None:
    path = tmp_path / "scenes.json"
    path.write_text(text)
    with pytest.raises(DataError, match=r"scenes.json' does not hold the scenes of a run"):
        RunScenes.load(path)


def test_a_card_whose_scenes_do_not_fit(tmp_path: Path) -> None:
    card = {"scene_tokens": ["a", "b"], "scene_names": ["one"], "scene_digests": ["", ""]}
    points = np.zeros((1, 20, 2), dtype=np.float32)
    TemplateSet(points, 0.25, np.ones(1, dtype=np.int64), card).save(tmp_path / "t.npz")
    with pytest.raises(DataError, match=r"card of .* is damaged"):
        TemplateSet.load(tmp_path / "t.npz")
    older = TemplateSet(points, 0.25, np.ones(1, dtype=np.int64), {"scene_tokens": ["a", "b"]})
    assert older.scenes == (KnownScene("", "a"), KnownScene("", "b"))


def test_what_evaluation_needs_is_looked_at_before_the_planner_is_asked(
    copy: TinyRun, tmp_path: Path
) -> None:
    # This planner gives no finite scores, which is said once it was asked.
    path = copy.folder / "checkpoints" / "last.ckpt"
    checkpoint = torch.load(path, weights_only=True)
    checkpoint["state_dict"] = {
        name: value * float("nan") if value.is_floating_point() else value
        for name, value in checkpoint["state_dict"].items()
    }
    torch.save(checkpoint, path)
    arguments = ("shoot-evaluate", copy.folder, "--out")
    assert "no finite scores" in refused(*arguments, tmp_path / "report.json")
    logs = read_table(copy.root, "log")
    logs[-1]["location"] = "singapore-queenstown"
    write_table(copy.root, "log", logs)
    write_road(copy.root, [WIDE_ROAD])
    said = refused(*arguments, tmp_path / "report.json")
    assert "singapore-queenstown.json' is missing" in said
    write_road(copy.root, [WIDE_ROAD], "singapore-queenstown")
    (copy.root / VERSION / "sample_annotation.json").write_text('[{"token": ')
    said = refused(*arguments, tmp_path / "report.json")
    assert "sample_annotation.json" in said
    said = refused(*arguments, tmp_path)
    assert f"'{tmp_path}': Is a directory" in said


def test_a_file_that_could_be_written_is_not(tmp_path: Path) -> None:
    path = tmp_path / "new" / "report.json"
    check_writable(path)
    assert list(path.parent.iterdir()) == []
    path.write_text("kept")
    check_writable(path)
    assert path.read_text() == "kept"
    with pytest.raises(OSError, match=r"report\.json"):
        check_writable(path / "below")
