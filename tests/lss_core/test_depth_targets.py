"""Depths that the lidar sees: where points fall, which bin they are of, and the loss they teach."""

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from ring_sweeps import write_sweeps
from tiny_tables import copy_tiny
from world_fixture import TinyRun, command, train_flags

from lss_core.batch import collate
from lss_core.config import CAMERAS, DataConfig, ImageConfig
from lss_core.data.dataset import CameraDataset
from lss_core.data.samples import load_index
from lss_core.depth_targets import batch_depth_bins, depth_bins, depth_loss, nearest_depths
from shoot.training.metrics_file import read_metrics

DEPTHS_M = (4.0, 6.0, 8.0, 10.0)
# A camera at 1.5 m that looks along x; 16 x 32 px in cells of 8.
POSE = torch.tensor(
    [[0.0, 0.0, 1.0, 0.0], [-1.0, 0.0, 0.0, 0.0], [0.0, -1.0, 0.0, 1.5], [0.0, 0.0, 0.0, 1.0]]
)
INTRINSICS = torch.tensor([[20.0, 0.0, 15.5], [0.0, 20.0, 7.5], [0.0, 0.0, 1.0]])
POINTS = torch.tensor([
    [10.0, 0.1, 1.4],  # u = 15.3, v = 7.7: row 1, column 1
    [7.0, 0.05, 1.45],  # nearer, the same cell
    [5.0, -3.0, 1.6],  # u = 27.5, v = 7.1: row 0, column 3
    [-5.0, 0.0, 1.5],  # behind
    [5.0, 30.0, 1.5],  # beside the image
])  # fmt: skip


def test_the_nearest_point_of_a_cell_counts() -> None:
    seen = nearest_depths(POINTS, INTRINSICS[None], POSE[None], (16, 32), 8)
    expected = torch.full((1, 2, 4), math.inf)
    expected[0, 1, 1], expected[0, 0, 3] = 7.0, 5.0
    torch.testing.assert_close(seen, expected)


def test_mixed_precision_moves_no_point() -> None:
    points = torch.rand(500, 3, generator=torch.Generator().manual_seed(0)) * 40.0 - 20.0
    expected = nearest_depths(points, INTRINSICS[None], POSE[None], (16, 32), 8)
    assert expected.isfinite().sum() > 3
    with torch.autocast("cpu", torch.bfloat16):
        assert torch.equal(
            nearest_depths(points, INTRINSICS[None], POSE[None], (16, 32), 8), expected
        )


def test_no_points_no_depths() -> None:
    seen = nearest_depths(POINTS[:0], INTRINSICS[None], POSE[None], (16, 32), 8)
    assert seen.shape == (1, 2, 4)
    assert seen.isinf().all()


def test_bins_reach_half_a_step_beyond_the_depths() -> None:
    depth_m = torch.tensor([2.9, 3.1, 4.9, 7.1, 10.9, 11.1, math.inf])
    assert depth_bins(depth_m, DEPTHS_M).tolist() == [-1, 0, 0, 2, 3, -1, -1]


def test_the_loss_is_the_mean_over_known_cells() -> None:
    prob = torch.tensor([0.1, 0.2, 0.3, 0.4]).view(1, 1, 4, 1, 1).expand(1, 1, 4, 1, 3)
    bins = torch.tensor([[[[1, -1, 3]]]])
    expected = -(math.log(0.2) + math.log(0.4)) / 2
    assert depth_loss(prob, bins).item() == pytest.approx(expected, rel=1e-5)
    assert depth_loss(prob, torch.full_like(bins, -1)).item() == 0.0


def test_targets_of_a_batch_follow_augmentation(tiny_run: TinyRun, tmp_path: Path) -> None:
    root = copy_tiny(tiny_run.root, tmp_path / "data")
    index = load_index(root, "v1.0-trainval", CAMERAS)
    write_sweeps(index, root)
    image = ImageConfig(height_px=32, width_px=96, flip=True)
    data = DataConfig(root=str(root), image=image)
    dataset = CameraDataset(index, np.arange(2), data, with_points=True)
    plain = collate([dataset[0, -1], dataset[1, -1]])
    assert (plain.point_counts > 0).all()
    masked = replace(plain, camera_mask=torch.zeros_like(plain.camera_mask))
    assert (batch_depth_bins(masked, (32, 96), 8, DEPTHS_M) == -1).all()
    wide = tuple(float(d) for d in range(2, 60, 2))
    bins = batch_depth_bins(plain, (32, 96), 8, wide)
    assert bins.shape == (2, 6, 4, 12)
    assert (bins >= 0).any()
    # Mirrored pixels see mirrored depths.
    flip = torch.tensor([[-1.0, 0.0, 95.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    mirrored = replace(plain, pixel_from_camera=flip @ plain.pixel_from_camera)
    assert torch.equal(batch_depth_bins(mirrored, (32, 96), 8, wide), bins.flip(-1))


def test_training_learns_depths_beside_planning(tiny_run: TinyRun, tmp_path: Path) -> None:
    root = copy_tiny(tiny_run.root, tmp_path / "data")
    write_sweeps(load_index(root, "v1.0-trainval", CAMERAS), root)
    flags = train_flags(root, tiny_run.templates, tmp_path / "run", 40, 20)
    said = command("shoot-train", *flags, "--optim.depth-weight", "1.0")
    assert said.status == 0, said.err
    rows = read_metrics(tmp_path / "run" / "metrics.csv").values()
    losses = [float(row["depth_loss"]) for row in rows if row.get("depth_loss")]
    assert losses[-1] < losses[0]
    # The planner made of it needs no lidar.
    for sweep in root.rglob("*.pcd.bin"):
        sweep.unlink()
    out = tmp_path / "report.json"
    assert command("shoot-evaluate", tmp_path / "run", "--out", out).status == 0
    assert json.loads(out.read_text())["num_samples"] == 15
