"""The camera model as a whole: the paper's symmetries, masks, sizes."""

import dataclasses

import pytest
import torch
from small_rig import IMAGE_HW, SMALL, rig
from torch import Tensor

from lss_core.batch import Batch
from lss_core.bev_encoder import BevEncoder
from lss_core.camera import frustum_points
from lss_core.config import ModelConfig
from lss_core.grid import BevGrid
from lss_core.model import CameraModel
from lss_core.splat import lift_splat

pytestmark = pytest.mark.trains


def _model(config: ModelConfig = SMALL, out_channels: int = 1) -> CameraModel:
    torch.manual_seed(0)
    return CameraModel(config, IMAGE_HW, out_channels).eval()


def _mask(images: Tensor) -> Tensor:
    return torch.ones(images.shape[:2], dtype=torch.bool)


@torch.no_grad()
def test_moving_image_and_principal_point_by_whole_cells_changes_nothing() -> None:
    """Symmetry 1 of the paper: translation of the pixels."""
    _, intrinsics, poses = rig(1, 3)
    context = torch.randn(1, 3, 6, 8, 12)
    depth_prob = torch.randn(1, 3, 10, 8, 12).softmax(dim=2)
    # What would leave the image at the right or below, and come in at the left or above, is empty.
    context[..., -2:] = 0.0
    context[..., -1:, :] = 0.0

    def to_map(features: Tensor, depth: Tensor, k: Tensor) -> Tensor:
        points = frustum_points(IMAGE_HW, 8, SMALL.depth.depths_m, k, poses)
        return lift_splat(features, depth, points, SMALL.grid)

    expected = to_map(context, depth_prob, intrinsics)
    moved = intrinsics.clone()
    moved[..., 0, 2] += 2 * 8.0
    moved[..., 1, 2] += 1 * 8.0
    shifts, dims = (2, 1), (-1, -2)
    result = to_map(context.roll(shifts, dims), depth_prob.roll(shifts, dims), moved)
    assert expected.abs().max() > 0.1
    torch.testing.assert_close(result, expected, atol=1e-5, rtol=1e-5)
    # And without moving the principal point the map does change.
    assert (to_map(context.roll(shifts, dims), depth_prob, intrinsics) - expected).abs().max() > 0.1


@torch.no_grad()
def test_the_order_of_cameras_does_not_matter() -> None:
    """Symmetry 2 of the paper."""
    images, intrinsics, poses = rig()
    model = _model()
    order = [2, 0, 1]
    expected = model(images, intrinsics, poses)
    result = model(images[:, order], intrinsics[:, order], poses[:, order])
    assert expected.std() > 1e-3
    torch.testing.assert_close(result, expected, atol=1e-5, rtol=1e-4)


@torch.no_grad()
def test_moving_the_ego_frame_by_whole_cells_moves_the_map() -> None:
    """Symmetry 3 of the paper, for moves that keep cells whole."""
    images, intrinsics, poses = rig()
    model = _model()
    expected = model.bev_features(images, intrinsics, poses, _mask(images))
    moved = poses.clone()
    moved[..., 0, 3] += 3.0
    moved[..., 1, 3] -= 2.0
    result = model.bev_features(images, intrinsics, moved, _mask(images))
    assert expected[..., :-3, 2:].abs().max() > 1e-3
    close = torch.isclose(result[..., 3:, :-2], expected[..., :-3, 2:], atol=1e-5)
    # Rounding may carry a point that lies on a cell's border over it, not more than that.
    assert close.float().mean() > 0.995


@torch.no_grad()
def test_turning_the_ego_frame_by_a_right_angle_turns_the_map() -> None:
    images, intrinsics, poses = rig()
    model = _model(dataclasses.replace(SMALL, grid=BevGrid(-12.0, 12.0, -12.0, 12.0, 1.0)))
    quarter = torch.tensor(
        [[0.0, -1.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
    )
    expected = model.bev_features(images, intrinsics, poses, _mask(images))
    result = model.bev_features(images, intrinsics, quarter @ poses, _mask(images))
    close = torch.isclose(result, expected.rot90(1, (-2, -1)), atol=1e-5)
    assert close.float().mean() > 0.995
    assert torch.isclose(result, expected, atol=1e-5).float().mean() < 0.9


@pytest.mark.parametrize("training", [False, True])
def test_a_masked_camera_changes_nothing(training: bool) -> None:
    images, intrinsics, poses = rig()
    expected = _model().train(training)(images, intrinsics, poses)
    # One more camera with a bright image and a calibration that cannot even be inverted.
    more = torch.cat([images, torch.full_like(images[:, :1], 255)], dim=1)
    more_intrinsics = torch.cat([intrinsics, torch.zeros_like(intrinsics[:, :1])], dim=1)
    more_poses = torch.cat([poses, torch.full_like(poses[:, :1], float("nan"))], dim=1)
    mask = torch.tensor([[True, True, True, False]]).expand(2, 4)
    model = _model().train(training)
    result = model(more, more_intrinsics, more_poses, mask)
    torch.testing.assert_close(result, expected, atol=1e-6, rtol=1e-5)
    result.sum().backward()
    assert all(p.grad is not None and p.grad.isfinite().all() for p in model.parameters())


@torch.no_grad()
def test_masks_that_differ_within_a_batch_equal_each_sample_alone() -> None:
    images, intrinsics, poses = rig()
    mask = torch.tensor([[True, False, True], [False, True, False]])
    together = _model()(images, intrinsics, poses, mask)
    for b in range(2):
        here = mask[b]
        alone = _model()(
            images[b : b + 1, here], intrinsics[b : b + 1, here], poses[b : b + 1, here]
        )
        torch.testing.assert_close(together[b : b + 1], alone, atol=1e-5, rtol=1e-4)


@torch.no_grad()
def test_without_any_camera_the_map_is_that_of_an_empty_grid() -> None:
    images, intrinsics, poses = rig()
    model = _model()
    result = model(images, intrinsics, poses, ~_mask(images))
    torch.testing.assert_close(result, model.bev_encoder(torch.zeros(2, 6, 24, 24)))


@torch.no_grad()
def test_bytes_and_fractions_are_the_same_image() -> None:
    images, intrinsics, poses = rig()
    model = _model()
    expected = model(images, intrinsics, poses)
    no_points = torch.zeros(0, 5), torch.zeros(2, dtype=torch.long)
    batch = Batch(images / 255.0, intrinsics, poses, _mask(images), torch.arange(2), *no_points)
    torch.testing.assert_close(model.forward_batch(batch), expected, atol=1e-5, rtol=1e-4)


@torch.no_grad()
def test_an_unchanged_calibration_is_not_indexed_again() -> None:
    images, intrinsics, poses = rig()
    model = _model()
    poses[1, 0, 0, 3] += 1.0
    first = model(images, intrinsics, poses)
    assert (model.cache.hits, model.cache.misses) == (0, 1)
    assert torch.equal(model(images, intrinsics, poses), first)
    assert (model.cache.hits, model.cache.misses) == (1, 1)
    poses[0, 0, 0, 3] += 2.0
    changed = model(images, intrinsics, poses)
    assert (model.cache.hits, model.cache.misses) == (1, 2)
    assert not torch.equal(changed[0], first[0])
    # A cache in use gives what a fresh one gives.
    assert torch.equal(_model()(images, intrinsics, poses), changed)


@torch.no_grad()
def test_the_splat_is_float32_under_mixed_precision() -> None:
    images, intrinsics, poses = rig()
    model = _model()
    expected = model.bev_features(images, intrinsics, poses, _mask(images))
    with torch.autocast("cpu", dtype=torch.bfloat16):
        result = model.bev_features(images, intrinsics, poses, _mask(images))
    assert result.dtype == torch.float32
    assert (result - expected).abs().max() < 0.05 * expected.abs().max()


def test_the_papers_network_has_the_papers_size() -> None:
    model = CameraModel(ModelConfig(pretrained="none"), (128, 352))
    count = sum(p.numel() for p in model.parameters())
    # 14.3 M in the paper counts 1,693,160 parameters of a classification head that never runs.
    assert count == pytest.approx(12_598_758, rel=0.01)
    assert count + 1_693_160 == pytest.approx(14.3e6, rel=0.01)


def test_every_parameter_learns() -> None:
    images, intrinsics, poses = rig()
    model = _model().train()
    model(images, intrinsics, poses).square().sum().backward()
    still = [n for n, p in model.named_parameters() if p.grad is None or not p.grad.abs().sum() > 0]
    # timm starts the last norm of each residual branch at zero, which hides the branch at first.
    assert all(".conv" in name or ".bn" in name for name in still), still
    assert any("image_encoder" in n and n not in still for n, _ in model.named_parameters())


@pytest.mark.parametrize("shape", [(24, 24), (25, 31), (50, 42), (8, 9)])
def test_maps_of_any_size_keep_their_size(shape: tuple[int, int]) -> None:
    encoder = BevEncoder(3, out_channels=2, stem_channels=4, decoder_channels=8).eval()
    with torch.no_grad():
        assert encoder(torch.randn(2, 3, *shape)).shape == (2, 2, *shape)


@torch.no_grad()
def test_what_happens_in_a_cell_shows_in_the_same_place() -> None:
    empty = torch.zeros(1, 3, 80, 64)
    spot = empty.clone()
    spot[..., 48:52, 28:32] = 5.0
    change = torch.zeros(80, 64)
    for seed in range(8):  # whatever the weights
        torch.manual_seed(seed)
        encoder = BevEncoder(3, stem_channels=8, decoder_channels=16, head_init_std=0.1).eval()
        change += (encoder(spot) - encoder(empty)).abs()[0, 0]
    place = torch.stack(torch.meshgrid(torch.arange(80.0), torch.arange(64.0), indexing="ij"), -1)
    centre = (place * change[..., None]).sum((0, 1)) / change.sum()
    # Convolutions of stride 2 look towards lower cells, by 3.5 of them at most; the rest is noise.
    torch.testing.assert_close(centre, torch.tensor([51.0, 31.0]), atol=4.0, rtol=0.0)


def test_costs_start_almost_equal_and_have_no_bias() -> None:
    torch.manual_seed(0)
    encoder = BevEncoder(3, stem_channels=8, decoder_channels=16)
    assert encoder(torch.randn(2, 3, 32, 32)).abs().max() < 0.05
    assert encoder.head.bias is None


def test_images_of_another_size_are_refused() -> None:
    images, intrinsics, poses = rig()
    with pytest.raises(ValueError, match="made for images of"):
        _model()(images[..., :48], intrinsics, poses)
    with pytest.raises(ValueError, match="multiples of image_stride=8"):
        CameraModel(SMALL, (60, 96))
