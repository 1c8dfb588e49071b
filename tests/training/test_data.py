import dataclasses
import itertools
import json
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from tiny_tables import KEPT_A_SCENE, TRAIN_A, VAL, VERSION, write_tiny

from lss_core.config import CAMERAS, DataConfig, ImageConfig
from lss_core.data.samples import load_index, rows_of_split
from lss_core.errors import DataError
from shoot.templates import TemplateSet, fit_templates
from shoot.training.config import OptimConfig
from shoot.training.data import TaskData
from shoot.training.planning.config import TrainConfig
from shoot.training.planning.data import PlanBatch, PlanningDataset, collate_plans, load_split
from shoot.training.planning.task import Planning
from shoot.training.samplers import ShareSampler, StepSampler
from shoot.trajectories import mine_futures


@pytest.fixture(scope="module")
def data(tiny_root: Path) -> DataConfig:
    return DataConfig(
        root=str(tiny_root), version=VERSION, image=ImageConfig(height_px=32, width_px=64)
    )


@pytest.fixture(scope="module")
def templates(data: DataConfig) -> TemplateSet:
    index = load_index(data.root, data.version, data.cameras)
    futures = mine_futures(index, rows_of_split(index, data.root, data.version, "train"), "sweeps")
    return fit_templates(futures.xy_m, k=5, seed=0)


@pytest.fixture
def config(data: DataConfig) -> TrainConfig:
    return TrainConfig(
        templates="templates.npz",
        out="run",
        data=data,
        optim=OptimConfig(steps=6, batch_size=4),
        val_every=3,
        num_workers=0,
    )


def test_split_is_labelled_by_the_nearest(data: DataConfig, templates: TemplateSet) -> None:
    split = load_split(data, "train", templates)
    assert len(split.labels) == 2 * KEPT_A_SCENE
    assert split.scene_names.tolist() == ["scene-0001"] * 7 + ["scene-0002"] * 7
    for future, label in zip(split.futures.xy_m, split.labels, strict=True):
        squares = ((templates.points - future) ** 2).sum(axis=(1, 2))
        assert squares[label] == squares.min()


def test_logs_are_known_where_one_of_the_data_set_holds_several_scenes(
    tmp_path: Path, data: DataConfig, templates: TemplateSet
) -> None:
    assert load_split(data, "train", templates).logs is None
    root = write_tiny(tmp_path / "d", cameras=CAMERAS[:2], image_hw=(36, 64))
    table = root / VERSION / "scene.json"
    scenes = json.loads(table.read_text())
    # The validation scene was cut from the same drive as one for training.
    scenes[2]["log_token"] = scenes[0]["log_token"]
    table.write_text(json.dumps(scenes))
    own = replace(data, root=str(root), cameras=CAMERAS[:2])
    logs = load_split(own, "train", templates).logs
    assert logs is not None
    assert logs.tolist() == ["scene-0001"] * 7 + ["scene-0002"] * 7
    logs = load_split(own, "val", templates).logs
    assert logs is not None
    assert logs.tolist() == ["scene-0001"] * KEPT_A_SCENE


def test_samples_without_images_leave_the_split(
    tmp_path: Path, data: DataConfig, templates: TemplateSet
) -> None:
    root = write_tiny(tmp_path / "d", (TRAIN_A, VAL), cameras=CAMERAS[:2], image_hw=(36, 64))
    own = replace(data, root=str(root), cameras=CAMERAS[:2])
    # One sample that counts and one that has no whole future anyway.
    for number in (2, 15):
        (root / "samples" / "CAM_FRONT" / f"scene-0001-{number:02d}.jpg").unlink()
    with pytest.raises(DataError, match="1 of 7 samples cannot be used"):
        load_split(own, "train", templates)
    split = load_split(replace(own, skip_bad=True), "train", templates)
    assert split.index.sample_token[split.futures.sample].tolist() == [
        f"scene-0001-{number:02d}" for number in (0, 1, 3, 4, 5, 6)
    ]
    assert split.futures.num_left_out == 10 + 1
    assert len(split.labels) == 6
    assert len(load_split(own, "train", templates, need_files=False).labels) == 7


def test_split_without_whole_futures_is_refused(
    tmp_path: Path, data: DataConfig, templates: TemplateSet
) -> None:
    short = replace(TRAIN_A, seconds=4.5)
    root = write_tiny(tmp_path / "d", (short,), cameras=CAMERAS[:1], image_hw=(36, 64))
    with pytest.raises(DataError, match=r"No sample of split 'train' .* has a whole future"):
        load_split(replace(data, root=str(root), cameras=CAMERAS[:1]), "train", templates)


def test_futures_have_the_points_of_the_templates(data: DataConfig) -> None:
    """The last of 8 points every 0.5 s is where the ego is after 4 s."""
    usual = TemplateSet(np.zeros((3, 20, 2), np.float32), 0.25, np.zeros(3, np.int64))
    coarse = TemplateSet(np.zeros((3, 8, 2), np.float32), 0.5, np.zeros(3, np.int64))
    expected, found = (load_split(data, "val", one).futures for one in (usual, coarse))
    assert found.dt_s == 0.5
    assert len(found.sample) > len(expected.sample)
    both = found.select(np.isin(found.sample, expected.sample))
    np.testing.assert_allclose(both.xy_m, expected.xy_m[:, 1:16:2], atol=1e-9)
    longer = TemplateSet(np.zeros((3, 80, 2), np.float32), 0.25, np.zeros(3, np.int64))
    with pytest.raises(DataError, match="a whole future, of 20 s"):
        load_split(data, "val", longer)


def test_items_pair_images_with_their_future(data: DataConfig, templates: TemplateSet) -> None:
    split = load_split(data, "train", templates)
    dataset = PlanningDataset(split, data, seed=0)
    for position in (0, 6, 7, 13):
        item = dataset[position, -1]
        assert item.sensors.sample_idx.item() == split.futures.sample[position]
        np.testing.assert_allclose(item.future, split.futures.xy_m[position], atol=1e-5)
        assert item.template_idx.item() == split.labels[position]


def test_inputs_know_nothing_of_the_future(data: DataConfig, templates: TemplateSet) -> None:
    # The same images with another drive after the first sample.
    split = load_split(data, "val", templates)
    index = split.index
    track = index.track(2)
    swerving = index.track_xy_m.copy()
    swerving[track][1:] += np.linspace(1.0, 30.0, track.stop - track.start - 1)[:, None]
    later = dataclasses.replace(index, track_xy_m=swerving)
    rows = rows_of_split(later, data.root, data.version, "val")
    futures = mine_futures(later, rows, "keyframes")
    other = dataclasses.replace(
        split, index=later, futures=futures, labels=templates.nearest(futures.xy_m)
    )
    before, after = (PlanningDataset(s, data, seed=0)[0, 4] for s in (split, other))
    assert not torch.allclose(before.future, after.future)
    for name, value in vars(before.sensors).items():
        same = getattr(after.sensors, name)
        assert torch.equal(value, same) if isinstance(value, torch.Tensor) else value == same, name


def test_plans_are_stacked(data: DataConfig, templates: TemplateSet) -> None:
    dataset = PlanningDataset(load_split(data, "val", templates), data, seed=0)
    batch = collate_plans([dataset[i, -1] for i in range(3)]).to("cpu")
    assert batch.future.shape == (3, 20, 2)
    assert batch.template_idx.shape == (3,)
    assert torch.equal(batch.future[2], dataset[2, -1].future)


def read_round(sampler: StepSampler, number: int) -> list[tuple[int, int]]:
    sampler.steps_done = lambda: number * sampler.steps
    return list(sampler)


@given(
    num_samples=st.integers(1, 40),
    steps=st.integers(1, 7),
    share=st.integers(1, 5),
    world_size=st.integers(1, 4),
    number=st.integers(0, 6),
)
def test_processes_together_read_what_one_reads(
    num_samples: int, steps: int, share: int, world_size: int, number: int
) -> None:
    batch = share * world_size
    alone = read_round(StepSampler(num_samples, steps, batch, seed=3), number)
    parts = [
        StepSampler(num_samples, steps, batch, 3, rank, world_size) for rank in range(world_size)
    ]
    shares = [read_round(part, number) for part in parts]
    assert (
        [len(part) for part in parts]
        == [len(one) for one in shares]
        == [steps * share] * (world_size)
    )
    for step in range(steps):
        together = [item for one in shares for item in one[step * share : (step + 1) * share]]
        assert sorted(together) == sorted(alone[step * batch : (step + 1) * batch])


def test_rounds_continue_one_stream() -> None:
    # Whole runs cut into rounds of different lengths read the same.
    one = StepSampler(10, 12, 3, seed=0)
    four = StepSampler(10, 3, 3, seed=0)
    assert read_round(one, 0) == [item for n in range(4) for item in read_round(four, n)]
    # A resumed process starts at a later round with a fresh sampler.
    assert read_round(StepSampler(10, 3, 3, seed=0), 2) == read_round(four, 2)


def test_each_pass_visits_each_sample_once_in_a_new_order() -> None:
    items = read_round(StepSampler(11, 11, 4, seed=1), 0)
    passes = [[i for i, _ in items[k : k + 11]] for k in range(0, 44, 11)]
    for one in passes:
        assert sorted(one) == list(range(11))
    assert len({tuple(one) for one in passes}) == 4


def test_draws_never_repeat_and_seeds_differ() -> None:
    items = [item for n in range(5) for item in read_round(StepSampler(7, 4, 3, seed=1), n)]
    draws = [draw for _, draw in items]
    assert draws == list(range(60))
    other = read_round(StepSampler(7, 20, 3, seed=2), 0)
    assert [i for i, _ in other] != [i for i, _ in items]


@given(num=st.integers(0, 30), world_size=st.integers(1, 5))
def test_shares_are_a_partition(num: int, world_size: int) -> None:
    positions = np.arange(num, dtype=np.int64) * 3
    shares = [ShareSampler(positions, rank, world_size) for rank in range(world_size)]
    read = [list(share) for share in shares]
    assert [len(share) for share in shares] == [len(one) for one in read]
    assert max(map(len, read)) - min(map(len, read)) <= 1
    together = list(itertools.chain(*read))
    assert sorted(i for i, _ in together) == positions.tolist()
    assert {draw for _, draw in together} <= {-1}


def test_training_loader_reads_a_round(config: TrainConfig, templates: TemplateSet) -> None:
    module = TaskData(config, Planning(config, templates))
    batches = list(module.train_dataloader())
    assert [len(batch.template_idx) for batch in batches] == [4, 4, 4]
    rows = torch.cat([batch.sensors.sample_idx for batch in batches]).tolist()
    order = [i for i, _ in StepSampler(14, 3, 4, config.seed)]
    assert rows == module.train_split.futures.sample[order].tolist()
    assert isinstance(batches[0], PlanBatch)


def test_validation_loader_reads_every_sample_once(
    config: TrainConfig, templates: TemplateSet
) -> None:
    module = TaskData(config, Planning(config, templates))
    batches = list(module.val_dataloader())
    assert [len(batch.template_idx) for batch in batches] == [7]
    rows = torch.cat([batch.sensors.sample_idx for batch in batches]).tolist()
    assert rows == module.val_split.futures.sample.tolist()


@pytest.mark.parametrize(("trains_on", "validates_on"), [(1, 8), (4, 8), (16, 32)])
def test_validation_takes_larger_batches(
    config: TrainConfig, templates: TemplateSet, trains_on: int, validates_on: int
) -> None:
    optim = replace(config.optim, batch_size=trains_on)
    module = TaskData(replace(config, optim=optim), Planning(config, templates))
    assert module.train_dataloader().batch_size == trains_on
    assert module.val_dataloader().batch_size == validates_on


@pytest.mark.parametrize(("wanted", "got"), [(1, 1), (3, 3), (7, 7), (100, 7)])
def test_fewer_validation_samples_are_spread(
    config: TrainConfig, templates: TemplateSet, wanted: int, got: int
) -> None:
    module = TaskData(replace(config, val_samples=wanted), Planning(config, templates))
    rows = torch.cat([b.sensors.sample_idx for b in module.val_dataloader()])
    assert len(set(rows.tolist())) == got
    if got == 3:
        assert (rows - rows[0]).tolist() == [0, 3, 6]


def test_workers_change_nothing(config: TrainConfig, templates: TemplateSet) -> None:
    alone = list(TaskData(config, Planning(config, templates)).train_dataloader())
    helped = list(
        TaskData(replace(config, num_workers=2), Planning(config, templates)).train_dataloader()
    )
    for one, other in zip(alone, helped, strict=True):
        assert torch.equal(one.sensors.images, other.sensors.images)
        assert torch.equal(one.template_idx, other.template_idx)


def test_splits_that_share_scenes_are_refused(config: TrainConfig, templates: TemplateSet) -> None:
    with pytest.raises(DataError, match="share 2 scenes"):
        TaskData(replace(config, val_split="train_detect"), Planning(config, templates))


def test_batch_must_be_shared_evenly(
    config: TrainConfig, templates: TemplateSet, monkeypatch: pytest.MonkeyPatch
) -> None:
    module = TaskData(config, Planning(config, templates))
    monkeypatch.setattr(module, "_share", lambda: (0, 3))
    with pytest.raises(DataError, match="batch of 4 cannot be shared by 3 processes"):
        module.train_dataloader()


def test_labels_are_spread_over_templates(data: DataConfig, templates: TemplateSet) -> None:
    # Two different drives never get the same label here: a constant label would pass unseen.
    labels = load_split(data, "train", templates).labels
    assert len(Counter(labels[:7].tolist()) & Counter(labels[7:].tolist())) == 0
