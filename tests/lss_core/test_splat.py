"""The fast splat against the definition and the paper's own formulation; borders by hand."""

import copy
import pickle

import pytest
import torch
from torch import Tensor

from lss_core.grid import BevGrid
from lss_core.splat import SplatCache, SplatIndex, build_splat_index, lift_splat, pool
from lss_core.splat_reference import lift_splat_cumsum, lift_splat_loop

GRID = BevGrid(-3.0, 5.0, -2.0, 2.0, 0.5)  # 16 x 8 cells


def _inputs(
    num_samples: int, num_cameras: int, seed: int = 0, dtype: torch.dtype = torch.float64
) -> tuple[Tensor, Tensor, Tensor]:
    """Context, depth and points; many points outside, many cells empty, a few points not finite."""
    generator = torch.Generator().manual_seed(seed)
    shape = (num_samples, num_cameras)
    context = torch.randn(*shape, 3, 2, 4, generator=generator, dtype=dtype)
    depth_prob = torch.randn(*shape, 5, 2, 4, generator=generator, dtype=dtype).softmax(dim=2)
    points = torch.randn(*shape, 5, 2, 4, 3, generator=generator) * torch.tensor([4.0, 2.0, 8.0])
    points[0, 0, 0, 0, 0, 0] = float("nan")
    points[0, 0, 1, 0, 0, 2] = float("nan")
    points[0, 0, 2, 0, 1, 1] = float("inf")
    return context.requires_grad_(), depth_prob.requires_grad_(), points


def _map_and_gradients(splat: object, *inputs: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    context, depth_prob, points = inputs
    result = splat(context, depth_prob, points, GRID)  # type: ignore[operator]
    weights = torch.linspace(-1.0, 2.0, result.numel(), dtype=result.dtype).view(result.shape)
    grads = torch.autograd.grad((result * weights).sum(), (context, depth_prob))
    return (result, *grads)


@pytest.mark.parametrize("num_cameras", [1, 2, 12])
@pytest.mark.parametrize("splat", [lift_splat, lift_splat_cumsum])
def test_fast_and_cumsum_equal_the_loop_forward_and_backward(
    splat: object, num_cameras: int
) -> None:
    inputs = _inputs(2, num_cameras)
    expected = _map_and_gradients(lift_splat_loop, *inputs)
    empty_share = (expected[0] == 0.0).all(dim=1).float().mean()
    assert 0.05 < empty_share < 0.95, "the inputs should leave some cells empty and fill some"
    for value, reference in zip(_map_and_gradients(splat, *inputs), expected, strict=True):
        torch.testing.assert_close(value, reference, rtol=1e-12, atol=1e-12)


def test_single_precision_equals_the_loop_to_its_rounding() -> None:
    inputs = _inputs(2, 6, dtype=torch.float32)
    result = lift_splat(*inputs, GRID)
    assert result.dtype == torch.float32
    expected = lift_splat_loop(*inputs, GRID)
    torch.testing.assert_close(result.double(), expected, rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("splat", [lift_splat, lift_splat_cumsum])
def test_gradcheck(splat: object) -> None:
    context, depth_prob, points = _inputs(2, 1)

    def to_map(c: Tensor, d: Tensor) -> Tensor:
        result: Tensor = splat(c, d, points, GRID)  # type: ignore[operator]
        return result

    assert torch.autograd.gradcheck(to_map, (context, depth_prob))


@pytest.mark.parametrize(
    ("xyz_m", "cell"),
    [
        ((-50.0, -50.0, 0.0), (0, 0)),
        ((49.9, -0.1, -10.0), (199, 99)),
        ((0.0, 0.0, 9.99), (100, 100)),
        ((-50.4, 0.0, 0.0), None),  # truncation toward zero folds this into cell 0
        ((0.0, -50.4, 0.0), None),
        ((50.0, 0.0, 0.0), None),
        ((0.0, 50.0, 0.0), None),
        ((0.0, 0.0, -10.01), None),  # and this into the only cell of height
        ((0.0, 0.0, -29.0), None),
        ((0.0, 0.0, 10.0), None),
    ],
)
def test_borders_of_the_grid_and_of_the_height(
    xyz_m: tuple[float, float, float], cell: tuple[int, int] | None
) -> None:
    context = torch.tensor([3.0, -2.0]).view(1, 1, 2, 1, 1)
    depth_prob = torch.full((1, 1, 1, 1, 1), 0.25)
    result = lift_splat(context, depth_prob, torch.tensor(xyz_m).view(1, 1, 1, 1, 1, 3), BevGrid())
    expected = torch.zeros(1, 2, 200, 200)
    if cell is not None:
        expected[0, :, cell[0], cell[1]] = torch.tensor([0.75, -0.5])
    torch.testing.assert_close(result, expected)


def test_samples_without_points_are_zero_and_leave_the_others_alone() -> None:
    context, depth_prob, points = _inputs(3, 2, dtype=torch.float32)
    alone = lift_splat(context[2:], depth_prob[2:], points[2:], GRID)
    points[:2] = 1000.0
    result = lift_splat(context, depth_prob, points, GRID)
    assert (result[:2] == 0.0).all()
    assert torch.equal(result[2:], alone)
    nothing = lift_splat(context[:2], depth_prob[:2], points[:2], GRID)
    grads = torch.autograd.grad(nothing.sum(), (context, depth_prob), materialize_grads=True)
    assert nothing.abs().sum() == 0.0
    assert all((grad == 0.0).all() for grad in grads)


def test_a_batch_is_its_samples_one_by_one() -> None:
    context, depth_prob, points = _inputs(4, 3, dtype=torch.float32)
    together = lift_splat(context, depth_prob, points, GRID)
    for b in range(4):
        one = slice(b, b + 1)
        assert torch.equal(
            together[one], lift_splat(context[one], depth_prob[one], points[one], GRID)
        )


def test_a_masked_camera_is_one_that_is_not_there() -> None:
    context, depth_prob, points = _inputs(1, 3, dtype=torch.float32)
    mask = torch.tensor([True, False, True])
    index = build_splat_index(points, GRID, camera_mask=mask[None])
    masked = pool(context, depth_prob, index, GRID)
    absent = lift_splat(context[:, mask], depth_prob[:, mask], points[:, mask], GRID)
    assert torch.equal(masked, absent)


def test_the_sum_is_float32_under_mixed_precision() -> None:
    # 4096 times 1/256 + 1/16: in bfloat16 a running sum stops growing long before the end.
    points = torch.zeros(1, 1, 1, 64, 64, 3)
    context = torch.full((1, 1, 1, 64, 64), 1.0)
    depth_prob = torch.full((1, 1, 1, 64, 64), 1 / 16 + 1 / 256)
    with torch.autocast("cpu", dtype=torch.bfloat16):
        result = lift_splat(context.bfloat16(), depth_prob.bfloat16(), points, GRID)
    assert result.dtype == torch.float32
    assert result.max() == 272.0


def test_nothing_of_the_size_of_the_lifted_features_is_built() -> None:
    context, depth_prob, points = _inputs(2, 2, dtype=torch.float32)
    lifted_numel = points[..., 0].numel() * context.shape[2]
    saved: list[int] = []

    def note(tensor: Tensor) -> Tensor:
        saved.append(tensor.numel())
        return tensor

    with torch.autograd.graph.saved_tensors_hooks(note, lambda t: t):
        lift_splat(context, depth_prob, points, GRID)
    assert saved
    assert max(saved) < lifted_numel


def test_points_of_a_cell_keep_their_order() -> None:
    points = torch.zeros(1, 2, 2, 1, 3, 3)  # 2 cameras, 2 depths, 1 x 3 pixels, all in one cell
    points[0, 0, 0, 0, 1] = 1000.0  # but for one
    index = build_splat_index(points, GRID)
    order = index.point_idx.tolist()
    assert order == [0, 1, 3, 4, 5, 6, 7, 8, 9, 10, 11, 2]
    cell = 6 * 8 + 4
    starts = index.bag_starts.tolist()
    assert starts[: 16 * 8] == [0] * (cell + 1) + [11] * (16 * 8 - cell - 1)
    assert starts[16 * 8 :] == [11]  # what lies outside has a bag of its own


def test_what_lies_outside_is_cut_into_short_bags() -> None:
    points = torch.zeros(2, 1, 1, 1, 600, 3)
    points[..., 100:, 0] = 1000.0
    starts = build_splat_index(points, GRID).bag_starts[2 * 16 * 8 :]
    lengths = torch.cat([starts, torch.tensor([1200])]).diff()
    assert int(starts[0]) == 200
    assert int(lengths.sum()) == 1000
    assert int(lengths.max()) <= 256


def test_no_size_of_an_index_depends_on_where_points_lie() -> None:
    points = _inputs(2, 3)[2]
    shapes = [
        [t.shape for t in (index.cell_of, index.inside, index.point_idx, index.bag_starts)]
        for index in (build_splat_index(p, GRID) for p in (points, points + 1.0, points + 1000.0))
    ]
    assert shapes[0] == shapes[1] == shapes[2]


def test_what_lies_outside_does_not_spoil_a_cell() -> None:
    context, depth_prob, points = _inputs(2, 2, dtype=torch.float32)
    points[1] = 1000.0
    spoilt = torch.full_like(context, float("nan"))
    spoilt = torch.cat([context[:1], spoilt[1:]])
    result = lift_splat(spoilt, depth_prob, points, GRID)
    assert torch.equal(result, lift_splat(context, depth_prob, points, GRID))


def _index(num_points: int) -> SplatIndex:
    points = torch.zeros(1, 1, 1, 1, num_points, 3)
    return build_splat_index(points, GRID)


def test_cache_keeps_what_was_used_last() -> None:
    cache = SplatCache(max_entries=2)
    first, second, third = _index(1), _index(2), _index(3)
    cache.put(b"1", first)
    cache.put(b"2", second)
    assert cache.get(b"1") is first
    cache.put(b"3", third)
    assert cache.get(b"2") is None
    assert cache.get(b"1") is first
    assert cache.get(b"3") is third
    assert (cache.hits, cache.misses, len(cache)) == (3, 1, 2)


def test_cache_is_bounded_in_bytes() -> None:
    one = _index(100)
    cache = SplatCache(max_bytes=int(2.5 * one.num_bytes))
    for key in range(10):
        cache.put(bytes([key]), one)
        cache.put(bytes([key]), one)  # again: counts once
    assert len(cache) == 2
    assert cache.get(bytes([9])) is one
    assert cache.get(bytes([7])) is None


def test_cache_keys_tell_calibrations_poses_and_masks_apart() -> None:
    intrinsics, poses = torch.eye(3).repeat(4, 1, 2, 1, 1), torch.eye(4).repeat(4, 1, 2, 1, 1)
    mask = torch.ones(4, 1, 2, dtype=torch.bool)
    intrinsics[1, 0, 1, 0, 2] = 1e-6
    poses[2, 0, 0, 0, 3] = 1e-6
    mask[3, 0, 1] = False

    def num_keys() -> int:
        return len(set(map(SplatCache.key, intrinsics, poses, mask)))

    assert num_keys() == 4
    intrinsics[1] = intrinsics[0]
    assert num_keys() == 3


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda c: pickle.loads(pickle.dumps(c))])
def test_copies_of_a_cache_start_empty(copied: object) -> None:
    cache = SplatCache(max_entries=7)
    cache.put(b"1", _index(1))
    twin = copied(cache)  # type: ignore[operator]
    assert len(twin) == 0
    assert twin.max_entries == 7
    assert twin.get(b"1") is None
    assert len(cache) == 1
