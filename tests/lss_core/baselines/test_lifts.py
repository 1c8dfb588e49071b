"""Our model beside the paper's baselines: equal sizes, and what each may and may not know."""

import dataclasses
import math

import pytest
import torch
from small_rig import IMAGE_HW, SMALL, rig
from torch import nn

from lss_core.camera import frustum_points
from lss_core.config import CAMERAS, DataConfig, ImageConfig, ModelConfig
from lss_core.errors import DataError
from lss_core.grid import BevGrid
from lss_core.model import CameraModel, ImagesToMap, make_model
from lss_core.splat import lift_splat
from shoot.training.planning import config as planning

pytestmark = pytest.mark.trains

LIFTS = ("depth", "uniform", "oft", "cnn")
GEOMETRIC = ("uniform", "oft")
DATA = DataConfig(
    image=ImageConfig(height_px=IMAGE_HW[0], width_px=IMAGE_HW[1]), cameras=CAMERAS[:4]
)


def _model(lift: str, freeze_encoder: bool = False, grid: BevGrid = SMALL.grid) -> ImagesToMap:
    torch.manual_seed(0)
    config = dataclasses.replace(SMALL, lift=lift, freeze_encoder=freeze_encoder, grid=grid)
    model = make_model(config, DATA)
    assert isinstance(model, ImagesToMap)
    return model.eval()


def _count(model: nn.Module) -> int:
    return sum(p.numel() for p in model.parameters())


@pytest.mark.parametrize("preset", [planning.SMALL, planning.PAPER], ids=["small", "paper"])
def test_all_have_as_many_parameters_to_a_twentieth(preset: planning.TrainConfig) -> None:
    def count(lift: str) -> int:
        # "cell": nothing is measured, which at the paper's size takes seconds.
        config: ModelConfig = dataclasses.replace(
            preset.model, pretrained="none", frustum="cell", lift=lift
        )
        return _count(make_model(config, preset.data, out_channels=4))

    ours = count("depth")
    counts = {lift: count(lift) for lift in LIFTS[1:]}
    assert len({ours, *counts.values()}) == 4
    assert all(abs(other - ours) < 0.05 * ours for other in counts.values()), (ours, counts)


@pytest.mark.parametrize("training", [False, True])
@pytest.mark.parametrize("lift", LIFTS)
def test_a_masked_camera_changes_nothing(lift: str, training: bool) -> None:
    images, intrinsics, poses = rig()
    expected = _model(lift).train(training)(images, intrinsics, poses)
    # One more camera with a bright image and a calibration that cannot even be inverted.
    more = torch.cat([images, torch.full_like(images[:, :1], 255)], dim=1)
    more_intrinsics = torch.cat([intrinsics, torch.zeros_like(intrinsics[:, :1])], dim=1)
    more_poses = torch.cat([poses, torch.full_like(poses[:, :1], math.nan)], dim=1)
    mask = torch.tensor([[True, True, True, False]]).expand(2, 4)
    model = _model(lift).train(training)
    result = model(more, more_intrinsics, more_poses, mask)
    torch.testing.assert_close(result, expected, atol=1e-6, rtol=1e-5)
    result.sum().backward()
    assert all(p.grad is not None and p.grad.isfinite().all() for p in model.parameters())


@torch.no_grad()
@pytest.mark.parametrize("lift", LIFTS)
def test_rigs_that_differ_within_a_batch_equal_each_sample_alone(lift: str) -> None:
    images, intrinsics, poses = rig()
    mask = torch.tensor([[True, False, True], [False, True, False]])
    model = _model(lift)
    together = model(images, intrinsics, poses, mask)
    assert (together[0] - together[1]).abs().max() > 1e-3
    for b in range(2):
        one = slice(b, b + 1)
        alone = model(images[one], intrinsics[one], poses[one], mask[one])
        torch.testing.assert_close(together[one], alone, atol=1e-5, rtol=1e-4)
        if lift in GEOMETRIC:
            here = mask[b]
            left = model(images[one, here], intrinsics[one, here], poses[one, here])
            torch.testing.assert_close(together[one], left, atol=1e-5, rtol=1e-4)


@torch.no_grad()
@pytest.mark.parametrize("lift", GEOMETRIC)
def test_the_order_of_cameras_does_not_matter(lift: str) -> None:
    images, intrinsics, poses = rig()
    model = _model(lift)
    order = [2, 0, 1]
    expected = model(images, intrinsics, poses)
    result = model(images[:, order], intrinsics[:, order], poses[:, order])
    assert expected.std() > 1e-3
    torch.testing.assert_close(result, expected, atol=1e-5, rtol=1e-4)


@torch.no_grad()
@pytest.mark.parametrize("lift", GEOMETRIC)
def test_moving_the_ego_frame_by_whole_cells_moves_the_map(lift: str) -> None:
    images, intrinsics, poses = rig()
    model = _model(lift)
    expected = model.bev_features(images, intrinsics, poses)
    moved = poses.clone()
    moved[..., 0, 3] += 3.0
    moved[..., 1, 3] -= 2.0
    result = model.bev_features(images, intrinsics, moved)
    assert expected[..., :-3, 2:].std() > 1e-3
    close = torch.isclose(result[..., 3:, :-2], expected[..., :-3, 2:], atol=1e-5)
    # Rounding may carry a point that lies on a cell's border over it, not more than that.
    assert close.float().mean() > 0.995
    assert torch.isclose(result, expected, atol=1e-5).float().mean() < 0.9


@torch.no_grad()
@pytest.mark.parametrize("lift", GEOMETRIC)
def test_turning_the_ego_frame_by_a_right_angle_turns_the_map(lift: str) -> None:
    images, intrinsics, poses = rig()
    model = _model(lift, grid=BevGrid(-12.0, 12.0, -12.0, 12.0, 1.0))
    quarter = torch.tensor(
        [[0.0, -1.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
    )
    expected = model.bev_features(images, intrinsics, poses)
    result = model.bev_features(images, intrinsics, quarter @ poses)
    close = torch.isclose(result, expected.rot90(1, (-2, -1)), atol=1e-5)
    assert close.float().mean() > 0.995
    assert torch.isclose(result, expected, atol=1e-5).float().mean() < 0.9


@torch.no_grad()
def test_convolutions_know_slots_and_no_calibration() -> None:
    images, intrinsics, poses = rig()
    model = _model("cnn")
    expected = model(images, intrinsics, poses)
    assert torch.equal(model(images, 3.0 * intrinsics, poses.flip(1)), expected)
    order = [2, 0, 1]
    others = model(images[:, order], intrinsics[:, order], poses[:, order])
    assert (others - expected).abs().max() > 1e-3


@torch.no_grad()
def test_the_top_of_the_images_lies_ahead() -> None:
    images, intrinsics, poses = rig(1)
    model = _model("cnn")
    spot = images.clone()
    spot[..., : IMAGE_HW[0] // 4, :] = 255
    change = model.bev_features(spot, intrinsics, poses) - model.bev_features(
        images, intrinsics, poses
    )
    behind, ahead = change.abs().mean(dim=(0, 1, 3)).chunk(2)
    assert ahead.sum() > 1.5 * behind.sum() > 0.0


def test_more_cameras_than_slots_are_refused() -> None:
    images, intrinsics, poses = rig(1, 5)
    with pytest.raises(DataError, match="for 4 cameras was given 5"):
        _model("cnn")(images, intrinsics, poses)


@torch.no_grad()
def test_depths_all_alike_are_spread_along_the_ray() -> None:
    images, intrinsics, poses = rig()
    model = _model("uniform")
    assert isinstance(model, CameraModel)
    context, depth_prob = model.encode_images(images)
    depths_m = SMALL.depth.depths_m
    assert torch.equal(depth_prob, torch.full_like(depth_prob, 1.0 / len(depths_m)))
    points = frustum_points(IMAGE_HW, 8, depths_m, intrinsics, poses, model.centers)
    expected = lift_splat(context, depth_prob, points, SMALL.grid)
    torch.testing.assert_close(model.bev_features(images, intrinsics, poses), expected)


@torch.no_grad()
def test_boxes_are_pooled_in_float32_under_mixed_precision() -> None:
    images, intrinsics, poses = rig()
    model = _model("oft")
    expected = model.bev_features(images, intrinsics, poses)
    with torch.autocast("cpu", dtype=torch.bfloat16):
        result = model.bev_features(images, intrinsics, poses)
    assert result.dtype == torch.float32
    assert (result - expected).abs().max() < 0.05 * expected.abs().max()


@pytest.mark.parametrize("lift", LIFTS)
def test_every_parameter_learns(lift: str) -> None:
    images, intrinsics, poses = rig()
    model = _model(lift).train()
    model(images, intrinsics, poses).square().sum().backward()
    still = [n for n, p in model.named_parameters() if p.grad is None or not p.grad.abs().sum() > 0]
    # timm starts the last norm of each residual branch at zero, which hides the branch at first.
    assert all(".conv" in name or ".bn" in name for name in still), still


@pytest.mark.parametrize("lift", LIFTS)
def test_a_frozen_backbone_stays_as_it_was(lift: str) -> None:
    images, intrinsics, poses = rig()
    model = _model(lift, freeze_encoder=True).train()
    free = _model(lift)
    assert all(
        torch.equal(value, free.state_dict()[name]) for name, value in model.state_dict().items()
    )
    backbone = model.image_encoder.backbone
    before = {name: value.clone() for name, value in backbone.state_dict().items()}
    optimizer = torch.optim.Adam(model.parameters(), lr=0.01, weight_decay=0.1)
    model(images, intrinsics, poses).square().sum().backward()
    optimizer.step()
    assert all(torch.equal(value, before[name]) for name, value in backbone.state_dict().items())
    rest = [(n, p) for n, p in model.named_parameters() if not n.startswith("image_encoder.back")]
    assert all(p.grad is not None for _, p in rest)
    # Of a whole batch and of each image alone it sees the same: no batch statistics.
    with torch.no_grad():
        flat = model.network_images(images.flatten(0, 1))
        together, alone = backbone(flat), backbone(flat[:1])
    torch.testing.assert_close(together[0][:1], alone[0], atol=1e-5, rtol=1e-4)
