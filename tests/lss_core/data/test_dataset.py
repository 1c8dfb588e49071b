import dataclasses
import logging
import math
from pathlib import Path

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from PIL import Image
from scipy.spatial.transform import Rotation
from tiny_tables import KEYFRAMES_A_SCENE, TRAIN_A, VAL, VERSION, camera_delay_s, write_tiny
from torch.utils.data import DataLoader

from lss_core.batch import Batch, collate
from lss_core.config import CAMERAS, DataConfig, ImageConfig
from lss_core.data.dataset import CameraDataset, ego_from_camera
from lss_core.data.samples import SampleIndex, load_index
from lss_core.data.usable import usable_rows
from lss_core.errors import DataError

IMAGE = ImageConfig(height_px=32, width_px=64)
STILL = ImageConfig(
    height_px=32, width_px=64, resize=(1.0, 1.0), crop_bottom=(0.1, 0.1), rotate_rad=0.0, flip=False
)


@pytest.fixture(scope="module")
def index(tiny_root: Path) -> SampleIndex:
    return load_index(tiny_root, VERSION, CAMERAS)


@pytest.fixture
def small_root(tmp_path: Path) -> Path:
    """Two scenes, two cameras, images that a test may damage."""
    return write_tiny(tmp_path / "data", (TRAIN_A, VAL), cameras=CAMERAS[:2], image_hw=(36, 64))


def all_rows(index: SampleIndex) -> NDArray[np.int64]:
    return np.arange(len(index.sample_token))


def dataset(index: SampleIndex, root: Path, seed: int = 0, **changes: object) -> CameraDataset:
    config = dataclasses.replace(
        DataConfig(root=str(root), version=VERSION, image=IMAGE),
        **changes,  # type: ignore[arg-type]
    )
    return CameraDataset(index, all_rows(index), config, seed)


def assert_same(one: Batch, other: Batch) -> None:
    for f in dataclasses.fields(Batch):
        torch.testing.assert_close(getattr(one, f.name), getattr(other, f.name), rtol=0, atol=0)


def test_item_is_what_the_index_says(index: SampleIndex, tiny_root: Path) -> None:
    row = index.row_of("scene-0002-05")
    item = dataset(index, tiny_root)[row, -1]
    assert item.images.shape == (6, 3, 32, 64)
    assert item.images.dtype == torch.uint8
    assert item.camera_mask.all()
    assert item.sample_idx.item() == row
    # 160 x 90 becomes 64 x 36; 11 % of 36 rows are cut off below, what is left above row 0.
    for n in range(6):
        focal = (0.8 * 160 + n) * 0.4
        expected = [
            [focal, 0.0, 80.0 * 0.4 - 0.3],
            [0.0, focal, 45.0 * 0.4 - 0.3 - (round(0.89 * 36) - 32)],
            [0.0, 0.0, 1.0],
        ]
        torch.testing.assert_close(item.pixel_from_camera[n], torch.tensor(expected))


def test_images_are_each_cameras_own(index: SampleIndex, tiny_root: Path) -> None:
    row = index.row_of("scene-0001-02")
    item = dataset(index, tiny_root)[row, -1]
    for n, camera in enumerate(CAMERAS):
        with Image.open(tiny_root / "samples" / camera / "scene-0001-02.jpg") as picture:
            small = np.asarray(picture.convert("RGB").resize((64, 36), Image.Resampling.BILINEAR))
        difference = np.abs(small[:32].astype(float) - item.images[n].permute(1, 2, 0).numpy())
        assert difference.mean() < 4.0


def test_car_moves_between_camera_and_lidar(index: SampleIndex, tiny_root: Path) -> None:
    # Straight ahead at 10 m/s: a camera that fires 40 ms early stands 0.4 m further back.
    row = index.row_of("scene-0003-04")
    moved = dataset(index, tiny_root)[row, -1].ego_from_camera
    still = dataset(index, tiny_root, ego_motion=False)[row, -1].ego_from_camera
    for n in range(6):
        shift = moved[n, :3, 3] - still[n, :3, 3]
        torch.testing.assert_close(
            shift, torch.tensor([10.0 * camera_delay_s(n), 0.0, 0.0]), atol=1e-4, rtol=0
        )
        torch.testing.assert_close(moved[n, :3, :3], still[n, :3, :3], atol=1e-6, rtol=0)
        torch.testing.assert_close(
            still[n, :3, 3], torch.tensor([1.7, 0.1 * n, 1.5]), atol=1e-6, rtol=0
        )


def test_car_turns_between_camera_and_lidar(index: SampleIndex) -> None:
    # Turning left at 0.1 rad/s: seen from the lidar's time, an early camera looks further right.
    row = index.row_of("scene-0001-06")
    moved, still = (ego_from_camera(index, row, ego_motion) for ego_motion in (True, False))
    for n in range(6):
        looks = math.atan2(*moved[n, [1, 0], 2]) - math.atan2(*still[n, [1, 0], 2])
        looks = (looks + math.pi) % (2.0 * math.pi) - math.pi
        assert looks == pytest.approx(0.1 * camera_delay_s(n), abs=1e-9)


def test_any_number_of_workers_gives_the_same(index: SampleIndex, tiny_root: Path) -> None:
    data = dataset(index, tiny_root, drop_cameras=2, extrinsic_noise_rad=0.01)
    items = [(position, 100 + i) for i, position in enumerate([3, 40, 7, 3, 21, 0])]
    plain = [collate([data[i] for i in items[k : k + 2]]) for k in (0, 2, 4)]
    for workers in (0, 2):
        loader = DataLoader(
            data, batch_size=2, sampler=items, num_workers=workers, collate_fn=collate
        )
        for one, other in zip(loader, plain, strict=True):
            assert_same(one, other)


def test_draws_differ_and_repeat(index: SampleIndex, tiny_root: Path) -> None:
    data = dataset(index, tiny_root)
    assert_same(data[4, 9], data[4, 9])
    assert not torch.equal(data[4, 9].images, data[4, 10].images)
    assert not torch.equal(data[4, 9].pixel_from_camera, data[4, 10].pixel_from_camera)
    other_seed = dataset(index, tiny_root, seed=1)
    assert not torch.equal(data[4, 9].images, other_seed[4, 9].images)


def test_cameras_are_augmented_independently(index: SampleIndex, tiny_root: Path) -> None:
    matrices = dataset(index, tiny_root)[0, 3].pixel_from_camera
    focal = matrices[:, :2, :2].det().abs().sqrt() / (0.8 * 160 + torch.arange(6))
    assert len({round(f.item(), 5) for f in focal}) > 3


def test_without_augmentation_all_draws_are_alike(index: SampleIndex, tiny_root: Path) -> None:
    data = dataset(index, tiny_root, image=STILL)
    assert_same(data[4, 9], data[4, 10])
    assert_same(data[4, 9], data[4, -1])


def test_evaluation_ignores_seed_noise_and_dropping(index: SampleIndex, tiny_root: Path) -> None:
    plain = dataset(index, tiny_root)
    rough = dataset(
        index,
        tiny_root,
        seed=5,
        drop_cameras=3,
        extrinsic_noise_rad=0.1,
        extrinsic_noise_m=1.0,
    )
    for position in (0, 20, 50):
        assert_same(plain[position, -1], rough[position, -1])


@pytest.mark.parametrize(("dropped", "shown"), [(0, 6), (1, 5), (5, 1)])
def test_dropped_cameras(index: SampleIndex, tiny_root: Path, dropped: int, shown: int) -> None:
    data = dataset(index, tiny_root, drop_cameras=dropped)
    seen = torch.zeros(6, dtype=torch.long)
    for draw in range(40):
        item = data[draw % 10, draw]
        assert item.camera_mask.sum().item() == shown
        assert (item.images[~item.camera_mask] == 0).all()
        seen += item.camera_mask
    assert (seen > 0).all()  # none is always dropped
    if shown < 6:
        assert (seen < 40).all()  # and none always kept


def test_noise_moves_cameras_by_its_deviation(index: SampleIndex, tiny_root: Path) -> None:
    sure = dataset(index, tiny_root, image=STILL)
    noisy = dataset(index, tiny_root, image=STILL, extrinsic_noise_rad=0.02, extrinsic_noise_m=0.3)
    turns, moves = [], []
    for draw in range(60):
        a, b = sure[0, draw].ego_from_camera.double(), noisy[0, draw].ego_from_camera.double()
        between = (a[:, :3, :3].transpose(1, 2) @ b[:, :3, :3]).numpy()
        turns.append(Rotation.from_matrix(between).as_rotvec())
        moves.append((b - a)[:, :3, 3].numpy())
        np.testing.assert_allclose(np.linalg.det(b[:, :3, :3].numpy()), 1.0, atol=1e-5)
    # 1080 numbers each: their deviation is known to a few per cent.
    assert np.std(turns) == pytest.approx(0.02, rel=0.1)
    assert np.std(moves) == pytest.approx(0.3, rel=0.1)
    assert abs(np.mean(moves)) < 0.04


def test_noise_is_each_cameras_own(index: SampleIndex, tiny_root: Path) -> None:
    sure = dataset(index, tiny_root)[0, 7].ego_from_camera
    noisy = dataset(index, tiny_root, extrinsic_noise_m=0.3)[0, 7].ego_from_camera
    moves = (noisy - sure)[:, :3, 3]
    assert (torch.pdist(moves) > 1e-3).all()


def test_noise_leaves_the_index_alone(index: SampleIndex, tiny_root: Path) -> None:
    before = index.egocam_from_camera.copy()
    _ = dataset(index, tiny_root, ego_motion=False, extrinsic_noise_m=1.0)[0, 1]
    np.testing.assert_array_equal(index.egocam_from_camera, before)


def test_camera_that_is_not_there_is_masked(index: SampleIndex, tiny_root: Path) -> None:
    has_camera = index.has_camera.copy()
    has_camera[3, 2] = False
    poorer = dataclasses.replace(index, has_camera=has_camera)
    whole, part = dataset(index, tiny_root)[3, 8], dataset(poorer, tiny_root)[3, 8]
    assert part.camera_mask.tolist() == [True, True, False, True, True, True]
    assert (part.images[2] == 0).all()
    # The other cameras are augmented as before.
    kept = part.camera_mask
    torch.testing.assert_close(part.images[kept], whole.images[kept])
    torch.testing.assert_close(part.pixel_from_camera[kept], whole.pixel_from_camera[kept])
    torch.testing.assert_close(part.ego_from_camera[kept], whole.ego_from_camera[kept])
    assert torch.isfinite(part.ego_from_camera).all()


def test_image_size_is_read_where_the_tables_lack_it(index: SampleIndex, tiny_root: Path) -> None:
    unsized = dataclasses.replace(index, image_hw=np.zeros_like(index.image_hw))
    assert_same(dataset(unsized, tiny_root)[5, 2], dataset(index, tiny_root)[5, 2])


def test_wrong_size_in_the_tables_is_named(index: SampleIndex, tiny_root: Path) -> None:
    wrong = dataclasses.replace(index, image_hw=index.image_hw * 10)
    with pytest.raises(DataError, match=r"scene-0001-00\.jpg' is 160x90 px, expected 1600x900"):
        _ = dataset(wrong, tiny_root)[0, -1]


def test_missing_image_is_named_or_skipped(
    small_root: Path, caplog: pytest.LogCaptureFixture
) -> None:
    index = load_index(small_root, VERSION, CAMERAS[:2])
    rows = all_rows(index)
    assert usable_rows(index, small_root, rows, skip_bad=False).rows.tolist() == rows.tolist()
    for number in (3, 9):
        (small_root / "samples" / "CAM_FRONT" / f"scene-0001-{number:02d}.jpg").unlink()
    with pytest.raises(DataError, match=r"2 of 34 samples .*scene-0001-03: '.*scene-0001-03\.jpg'"):
        usable_rows(index, small_root, rows, skip_bad=False)
    with caplog.at_level(logging.WARNING):
        left = usable_rows(index, small_root, rows, skip_bad=True)
    assert "Left out 2 of 34 samples: 2 missing image" in caplog.text
    assert set(rows.tolist()) - set(left.rows.tolist()) == {3, 9}
    assert [one.sample for one in left.left_out] == ["scene-0001-03", "scene-0001-09"]
    with pytest.raises(DataError, match="None of 1 samples can be used"):
        usable_rows(index, small_root, rows[3:4], skip_bad=True)


def test_samples_without_any_camera_are_not_usable(small_root: Path) -> None:
    index = load_index(small_root, VERSION, CAMERAS[:2])
    has_camera = index.has_camera.copy()
    has_camera[5] = False
    has_camera[6, 0] = False  # one of two is enough
    poorer = dataclasses.replace(index, has_camera=has_camera)
    rows = all_rows(index)
    with pytest.raises(DataError, match=r"1 of 34 .*sample scene-0001-05: it has no image"):
        usable_rows(poorer, small_root, rows, skip_bad=False)
    left = usable_rows(poorer, small_root, rows, skip_bad=True).rows
    assert len(left) == 2 * KEYFRAMES_A_SCENE - 1


def test_truncated_jpeg_is_named(small_root: Path) -> None:
    path = small_root / "samples" / "CAM_FRONT" / "scene-0001-03.jpg"
    path.write_bytes(path.read_bytes()[:600])
    index = load_index(small_root, VERSION, CAMERAS[:2])
    with pytest.raises(DataError, match=r"scene-0001-03\.jpg' (is damaged|cannot be read)"):
        _ = dataset(index, small_root)[3, 1]


def test_batch_moves_and_stacks(index: SampleIndex, tiny_root: Path) -> None:
    data = dataset(index, tiny_root)
    batch = collate([data[0, -1], data[30, -1]]).to("cpu")
    assert batch.images.shape == (2, 6, 3, 32, 64)
    assert batch.sample_idx.tolist() == [0, 30]
    torch.testing.assert_close(batch.images[1], data[30, -1].images)
