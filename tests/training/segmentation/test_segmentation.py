"""Segmentation as a task: what is trained on, its loss, and runs through the command."""

import csv
import json
import math
import signal
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from resumption import assert_same_run, checkpoint, wait_for
from torch.nn import functional as F
from world_fixture import TinyRun, TinySegmenter, command, complaint, segment_flags, start_command

from lss_core.batch import collate
from lss_core.bev_encoder import BevEncoder
from lss_core.data.samples import load_index
from lss_core.labels import sample_labels
from shoot.training.module import TaskModule
from shoot.training.segmentation.config import SegmentConfig
from shoot.training.segmentation.data import SegmentBatch
from shoot.training.segmentation.task import Segmentation
from shoot.training.task import Task

STEPS, EVERY = 6, 2


@pytest.fixture(scope="module")
def config(tiny_segmenter: TinySegmenter) -> SegmentConfig:
    return SegmentConfig.load(tiny_segmenter.folder / "config.yaml")


def test_it_is_a_task(config: SegmentConfig) -> None:
    assert isinstance(Segmentation(config), Task)


@pytest.mark.trains
def test_a_rare_class_is_soon_found(config: SegmentConfig) -> None:
    """From log-odds of 0 it is found nowhere: all that is learned speaks against it."""
    torch.manual_seed(0)
    task = Segmentation(replace(config, classes=("car",), pos_weights=(10.0,)))
    sensors = task.dataset(task.load_split(config.data, "val"), config)[0, -1].sensors
    net, head = BevEncoder(1, 1, stem_channels=8, decoder_channels=16), task.new_head()
    optimizer = torch.optim.Adam([*net.parameters(), *head.parameters()], lr=2e-3)
    metrics = task.new_metrics()
    for step in range(150):
        cars = F.max_pool2d((torch.rand(4, 1, 48, 48) < 0.003).float(), 3, 1, 1)
        batch = SegmentBatch(collate([sensors] * 4), cars.to(torch.uint8))
        maps = net(cars + torch.randn_like(cars))
        loss = task.loss(head, maps, batch)
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        if step >= 140:
            task.measure(metrics, task.outputs(head, maps), batch)
    assert metrics.compute()["iou_car"] > 10.0


def test_every_keyframe_is_a_target_though_none_has_a_future(config: SegmentConfig) -> None:
    task = Segmentation(config)
    split = task.load_split(config.data, "train")
    scenes = split.index.sample_scene
    assert len(split) == np.isin(scenes, np.unique(split.scene_rows)).sum() > 0
    assert split.num_left_out == 0
    spans_s = [np.ptp(split.index.time_s[scenes == scene]) for scene in np.unique(scenes)]
    assert max(spans_s) < 5.0


def test_labels_are_those_of_the_sample(config: SegmentConfig) -> None:
    task = Segmentation(config)
    split = task.load_split(config.data, "val")
    dataset = task.dataset(split, config)
    data, grid = config.data, config.model.grid
    for position in (0, len(split) - 1):
        sample = dataset[position, -1]
        row = int(split.rows[position])
        assert int(sample.sensors.sample_idx) == row
        token = str(split.index.sample_token[row])
        expected = sample_labels(Path(data.root), data.version, token, grid, config.classes)
        stacked = np.stack([expected[name] for name in config.classes])
        assert stacked.any(axis=(1, 2)).sum() >= 2
        np.testing.assert_array_equal(sample.labels.numpy(), stacked)


def test_keyframes_that_no_camera_has_seen_are_no_targets(
    config: SegmentConfig, tiny_segmenter: TinySegmenter, tmp_path: Path
) -> None:
    """As at the end of scenes of a city with a tail: models that see lidar leave them out, too."""
    root = tmp_path / "city"
    root.mkdir()
    for part in ("maps", "samples"):
        (root / part).symlink_to(tiny_segmenter.root / part)
    tables = root / config.data.version
    tables.mkdir()
    for file in (tiny_segmenter.root / config.data.version).iterdir():
        (tables / file.name).symlink_to(file)
    index = load_index(root, config.data.version, config.data.cameras)
    scene = int(index.sample_scene[0])
    last = str(index.sample_token[np.flatnonzero(index.sample_scene == scene)[-1]])
    file = tables / "sample_data.json"
    rows = json.loads(file.read_text())
    kept = [
        row
        for row in rows
        if row["sample_token"] != last or not row["filename"].startswith("samples/CAM")
    ]
    assert len(kept) == len(rows) - 6
    file.unlink()
    file.write_text(json.dumps(kept))
    name = str(index.scene_name[scene])
    for scans in (0, 1):
        data = replace(config.data, root=str(root), lidar_scans=scans)
        task = Segmentation(config)
        splits = [task.load_split(data, name) for name in ("train", "val")]
        (split,) = (one for one in splits if name in one.scene_names)
        assert last not in split.index.sample_token[split.rows]
        assert split.num_left_out == 1


def test_loss_is_the_mean_cross_entropy_with_positive_cells_weighted(
    config: SegmentConfig,
) -> None:
    dataset = Segmentation(config).dataset(
        Segmentation(config).load_split(config.data, "val"), config
    )
    task = Segmentation(replace(config, classes=("car", "drivable"), pos_weights=(1.0, 5.0)))
    logit = torch.tensor([[[[0.3, -1.0]], [[2.0, 0.5]]]])  # B, C, X, Y = 1, 2, 1, 2
    truth = torch.tensor([[[[1, 0]], [[0, 1]]]], dtype=torch.uint8)
    batch = SegmentBatch(collate([dataset[0, -1].sensors]), truth)
    log1pexp = [math.log1p(math.exp(x)) for x in (-0.3, -1.0, 2.0, -0.5)]
    expected = (log1pexp[0] + log1pexp[1] + log1pexp[2] + 5.0 * log1pexp[3]) / 4
    head = task.new_head()
    maps = logit - task.outputs(head, torch.zeros_like(logit))
    assert task.loss(head, maps, batch).item() == pytest.approx(expected, rel=1e-6)


@pytest.mark.trains
def test_a_network_learns_one_batch_by_heart(config: SegmentConfig) -> None:
    torch.manual_seed(0)
    task = Segmentation(config)
    dataset = task.dataset(task.load_split(config.data, "val"), config)
    batch = task.collate([dataset[position, -1] for position in (0, 1)])
    module = TaskModule(config, task)
    optimizer = torch.optim.Adam(module.parameters(), lr=0.02)
    for _ in range(120):
        optimizer.zero_grad()
        maps = module.model.forward_batch(batch.sensors)
        task.loss(module.get_submodule(task.name), maps, batch).backward()
        optimizer.step()
    metrics = task.new_metrics()
    task.measure(metrics, module(batch.sensors), batch)
    assert metrics.compute()["iou_drivable"] > 80.0


def test_validation_writes_an_overlap_for_each_class(
    config: SegmentConfig, tiny_segmenter: TinySegmenter
) -> None:
    with (tiny_segmenter.folder / "metrics.csv").open() as stream:
        rows = [row for row in csv.DictReader(stream) if row["val_iou"]]
    assert len(rows) == 2
    by_class = [float(rows[-1][f"val_iou_{name}"]) for name in config.classes]
    assert all(math.isnan(value) or 0.0 <= value <= 100.0 for value in by_class)
    assert float(rows[-1]["val_iou"]) == pytest.approx(np.nanmean(by_class))


@pytest.mark.trains
@pytest.mark.full  # the loop is the planners', whose tests of it run every day
def test_killed_run_ends_as_an_undisturbed_one(
    tiny_segmenter: TinySegmenter, tmp_path: Path
) -> None:
    runs = {name: tmp_path / name for name in ("killed", "undisturbed")}
    flags = {n: segment_flags(tiny_segmenter.root, f, STEPS, EVERY) for n, f in runs.items()}
    process = start_command("shoot-train", *flags["killed"], log=tmp_path / "log")
    wait_for(runs["killed"] / "checkpoints" / "last.ckpt", process)
    process.kill()
    process.join()
    assert process.exitcode == -signal.SIGKILL
    assert checkpoint(runs["killed"])["global_step"] < STEPS
    for name, more in (("undisturbed", []), ("killed", ["--resume"])):
        said = command("shoot-train", *flags[name], *more)
        assert said.status == 0, said.err
    assert_same_run(runs["killed"], runs["undisturbed"])


def test_what_cannot_be_trained_is_said_in_one_sentence(
    tiny_segmenter: TinySegmenter, tiny_run: TinyRun, tmp_path: Path
) -> None:
    flags = segment_flags(tiny_segmenter.root, tmp_path / "run", 2, 2)
    without_labels = segment_flags(tiny_run.root, tmp_path / "run", 2, 2)
    for arguments, words in (
        ((*flags, "--classes", "car", "tree", "--pos-weights", "1", "1"), "tree"),
        ((*flags, "--classes", "car"), "There are 1 classes but 4 pos_weights"),
        ((*without_labels, "--classes", "car", "--pos-weights", "1"), "annotation"),
        ((*without_labels, "--classes", "drivable", "--pos-weights", "1"), "map"),
    ):
        assert words in complaint(command("shoot-train", *arguments))
    assert not (tmp_path / "run" / "checkpoints" / "last.ckpt").exists()


def test_a_run_goes_on_with_its_own_classes_only(tiny_segmenter: TinySegmenter) -> None:
    flags = segment_flags(tiny_segmenter.root, tiny_segmenter.folder, 4, 2)
    said = command(
        "shoot-train", *flags, "--resume", "--classes", "car", "drivable", "--pos-weights", "1", "1"
    )
    assert "other settings of classes, pos_weights" in complaint(said)
