"""shoot-evaluate and shoot-render on a run of a segmentation."""

import json
import shutil
from pathlib import Path

import matplotlib.image as mpl_image
import numpy as np
import pytest
import torch
from world_fixture import TinySegmenter, command, complaint

from shoot.evaluation.segmentation.paired import load_overlaps, paired_iou
from shoot.prediction.segmenter import open_segmenter, predict_maps
from shoot.training.segmentation.label_frequency import FILE, load_frequency


def test_evaluate_writes_the_scores_of_all_cells(
    tiny_segmenter: TinySegmenter, tmp_path: Path
) -> None:
    out = tmp_path / "report.json"
    said = command("shoot-evaluate", tiny_segmenter.folder, "--out", out)
    assert said.status == 0, said.err
    assert "IoU, %" in said.out
    report = json.loads(out.read_text())
    run = open_segmenter(tiny_segmenter.folder)
    split = run.task.load_split(run.config.data, "val")
    found = list(predict_maps(run, split))
    said_there = torch.cat([prob for _, prob in found]) >= 0.5
    there = torch.cat([batch.labels for batch, _ in found]) == 1
    assert report["task"] == "segmentation"
    assert (report["num_samples"], report["num_seen_scenes"]) == (len(split), 0)
    for c, name in enumerate(run.config.classes):
        union = int((said_there | there)[:, c].sum())
        expected = 100.0 * int((said_there & there)[:, c].sum()) / union
        assert report["classes"][name]["iou"]["value"] == pytest.approx(expected)
        assert report["classes"][name]["share_true"] == pytest.approx(
            100.0 * float(there[:, c].double().mean())
        )
    assert set(report["baselines"]["prior_map"]) == set(run.config.classes)
    overlaps = load_overlaps(out)
    assert all(it.value == 0.0 for it in paired_iou([overlaps], [overlaps]).values())


def test_the_run_keeps_how_often_cells_are_of_a_class(tiny_segmenter: TinySegmenter) -> None:
    run = open_segmenter(tiny_segmenter.folder)
    split = run.task.load_split(run.config.data, "train")
    labels = np.stack([split.labels.read(int(row)) for row in split.rows])
    kept = load_frequency(tiny_segmenter.folder, labels.shape[1:])
    np.testing.assert_allclose(kept, labels.mean(axis=0), atol=1e-6)


def test_scenes_of_the_training_are_scored_on_demand_only(
    tiny_segmenter: TinySegmenter, tmp_path: Path
) -> None:
    out = tmp_path / "report.json"
    seen = ("shoot-evaluate", tiny_segmenter.folder, "--split", "train", "--out", out)
    said = command(*seen)
    assert "was trained on 2 of the scenes" in complaint(said)
    folder = tmp_path / "run"
    shutil.copytree(tiny_segmenter.folder, folder)
    (folder / "scenes.json").unlink()
    (folder / FILE).unlink()
    said = command("shoot-evaluate", folder, "--out", out)
    assert "nobody knows what the run was trained on" in complaint(said)
    assert not out.exists()
    said = command(*seen, "--allow-seen-scenes")
    assert said.status == 0, said.err
    assert "2 SEEN in training" in " ".join(said.out.split())
    assert json.loads(out.read_text())["num_seen_scenes"] == 2
    # Without its list, and without the baseline's file, it is still scored.
    said = command("shoot-evaluate", folder, "--out", out, "--allow-seen-scenes")
    assert said.status == 0, said.err
    assert json.loads(out.read_text())["baselines"] == {}


@pytest.mark.parametrize("damage", [b"", np.zeros(3)])
def test_damaged_shares_end_in_one_sentence(
    tiny_segmenter: TinySegmenter, tmp_path: Path, damage: object
) -> None:
    folder = tmp_path / "run"
    shutil.copytree(tiny_segmenter.folder, folder)
    if isinstance(damage, bytes):
        (folder / FILE).write_bytes(damage)
    else:
        np.savez(folder / FILE, frequency=np.asarray(damage))
    said = command("shoot-evaluate", folder, "--out", tmp_path / "report.json")
    assert FILE in complaint(said)


def test_what_only_planners_can_do_is_refused(
    tiny_segmenter: TinySegmenter, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    said = command(
        "shoot-evaluate", tiny_segmenter.folder, "--out", out, "--fast", "--html", tmp_path / "a"
    )
    assert "--html and --fast can be asked of a planner only" in complaint(said)
    said = command("shoot-render", tiny_segmenter.folder, "--out", out, "--lidar")
    assert "--lidar can be asked of a planner only" in complaint(said)
    assert not out.exists()


def test_render_draws_samples_or_the_one_asked_for(
    tiny_segmenter: TinySegmenter, tmp_path: Path
) -> None:
    said = command("shoot-render", tiny_segmenter.folder, "--out", tmp_path / "few", "--num", 2)
    assert said.status == 0, said.err
    pictures = sorted((tmp_path / "few").glob("*.png"))
    assert len(pictures) == 2
    image = mpl_image.imread(pictures[0])
    assert image.shape[1] == 1800
    assert image.std() > 0.1
    token = pictures[0].stem
    again = command("shoot-render", tiny_segmenter.folder, "--out", tmp_path, "--token", token)
    assert again.status == 0, again.err
    assert (tmp_path / f"{token}.png").read_bytes() == pictures[0].read_bytes()
    said = command("shoot-render", tiny_segmenter.folder, "--out", tmp_path, "--token", "absent")
    assert "absent" in complaint(said)
