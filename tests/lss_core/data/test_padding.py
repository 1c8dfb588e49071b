"""How much of the network's image is black: measured, reported and limited."""

import dataclasses
import logging
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from tiny_tables import TRAIN_A, VAL, VERSION, write_tiny
from world_fixture import TinyRun, command, train_flags

from lss_core.config import CAMERAS, DataConfig, ImageConfig
from lss_core.data.padding import check_padding, padding
from lss_core.data.samples import SampleIndex, load_index
from lss_core.data.sensors.images import draw_pixel_map, load_image
from lss_core.errors import DataError
from shoot.training.planning.config import PRESETS

CAMS = CAMERAS[:2]


@pytest.fixture(scope="module")
def index(tiny_root: Path) -> SampleIndex:
    return load_index(tiny_root, VERSION, CAMERAS)


def check(index: SampleIndex, root: Path, image: ImageConfig, training: bool = False) -> None:
    data = DataConfig(root=str(root), version=VERSION, image=image)
    check_padding(index, data, np.arange(len(index.sample_token)), training)


@pytest.mark.parametrize("seed", range(12))
def test_share_is_that_of_black_pixels(tmp_path: Path, seed: int) -> None:
    rng = np.random.default_rng(seed)
    raw_h, raw_w = (int(side) for side in rng.integers(30, 200, 2))
    Image.new("RGB", (raw_w, raw_h), (255, 255, 255)).save(tmp_path / "white.png")
    image = ImageConfig(40, 110, (0.3, 1.2), (0.0, 0.9), rotate_rad=0.0)
    pixel_map = draw_pixel_map(image, (raw_h, raw_w), rng, float(rng.uniform(0, raw_h)))
    black = (load_image(tmp_path / "white.png", pixel_map) == 0).mean()
    assert pixel_map.padding == pytest.approx(black, abs=1e-12)


def test_shares_by_hand() -> None:
    # KITTI's 1242 x 375 fill 352 x 128 by height: cutting 11 % of 128 rows leaves 114.
    assert padding(ImageConfig(), (375, 1242)) == 14 / 128
    # At 0.5 of the size that fills it, half the width and 99 of 128 rows are left.
    half = ImageConfig(resize=(0.5, 0.5), crop_bottom=(0.0, 0.0))
    assert padding(half, (900, 1600), training=True) == pytest.approx(1 - 0.5 * 99 / 128)
    assert padding(half, (900, 1600)) == 0.0


@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize(
    "raw_hw", [(900, 1600), (375, 1242), (1280, 1920), (886, 1920), (1024, 1224), (2048, 1550)]
)
def test_presets_are_below_the_limit_on_known_cameras(preset: str, raw_hw: tuple[int, int]) -> None:
    image = PRESETS[preset][1].data.image
    assert padding(image, raw_hw) < 0.25
    assert padding(image, raw_hw, training=True) < 0.25


def test_nothing_is_said_where_nothing_is_black(
    index: SampleIndex, tiny_root: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.INFO):
        check(index, tiny_root, ImageConfig(32, 64))
    assert not caplog.records


def test_a_little_black_is_reported(
    index: SampleIndex, tiny_root: Path, caplog: pytest.LogCaptureFixture
) -> None:
    # 160 x 90 fill 64 x 36; cutting 30 % leaves 25 of 32 rows.
    with caplog.at_level(logging.INFO):
        check(index, tiny_root, ImageConfig(32, 64, crop_bottom=(0.3, 0.3)))
    assert len(caplog.records) == 1
    assert "22% of the 64x32 px" in caplog.text
    assert "CAM_FRONT_LEFT (160x90 px)" in caplog.text


@pytest.mark.parametrize(
    ("changes", "training"),
    [
        # Resize factors of other projects, relative to the file's own size.
        ({"resize": (0.38, 0.55)}, True),
        ({"resize": (0.2, 0.25)}, True),
        ({"crop_bottom": (0.8, 0.8)}, False),
        ({"crop_bottom": (0.3, 0.9)}, False),
        ({"crop_bottom": (0.0, 0.95)}, True),
    ],
)
def test_more_than_a_quarter_of_black_is_refused(
    index: SampleIndex,
    tiny_root: Path,
    changes: dict[str, tuple[float, float]],
    training: bool,
) -> None:
    image = dataclasses.replace(ImageConfig(32, 64), **changes)  # type: ignore[arg-type]
    with pytest.raises(DataError, match=r"% of the 64x32 px .* CAM_FRONT_LEFT \(160x90 px\)") as e:
        check(index, tiny_root, image, training)
    assert "--data.image.resize" in str(e.value)
    assert "--data.image.crop-bottom" in str(e.value)
    assert "\n" not in str(e.value)


def test_the_worst_camera_is_named_and_sizes_are_read_where_tables_lack_them(
    tmp_path: Path,
) -> None:
    root = write_tiny(tmp_path / "data", (TRAIN_A, VAL), cameras=CAMS, image_hw=(36, 64))
    index = load_index(root, VERSION, CAMS)
    image_hw = index.image_hw.copy()
    image_hw[:, 0] = 0
    image_hw[5, 1] = (20, 64)  # one sample is enough
    mixed = dataclasses.replace(index, image_hw=image_hw)
    image = ImageConfig(32, 64, crop_bottom=(0.3, 0.3))
    with pytest.raises(DataError, match=r"CAM_FRONT \(64x20 px\)"):
        check(mixed, root, image)
    image_hw[5, 1] = (36, 64)
    check(dataclasses.replace(index, image_hw=image_hw), root, image)
    (root / str(index.image_path[0, 0])).unlink()
    with pytest.raises(DataError, match="is missing"):
        check(dataclasses.replace(index, image_hw=image_hw), root, image)


@pytest.mark.parametrize(
    "flags",
    [
        ("--data.image.resize", 0.38, 0.55),
        ("--data.image.crop-bottom", 11, 11),
        ("--data.image.crop-bottom", 0.9, 0.9),
    ],
)
def test_training_ends_in_a_sentence(
    tiny_run: TinyRun, tmp_path: Path, flags: tuple[str | float, ...]
) -> None:
    said = command(
        "shoot-train", *train_flags(tiny_run.root, tiny_run.templates, tmp_path / "run", 4, 2),
        *map(str, flags),
    )  # fmt: skip
    assert said.status == 2
    assert str(flags[0]).rsplit(".", 1)[-1] in said.err.replace("_", "-")
    assert "Traceback" not in said.err


def test_evaluation_ends_in_a_sentence(tiny_run: TinyRun, tmp_path: Path) -> None:
    run = tmp_path / "run"
    run.mkdir()
    for file in tiny_run.folder.iterdir():
        if file.is_file():
            (run / file.name).write_bytes(file.read_bytes())
    config = (run / "config.yaml").read_text()
    assert "- 0.11\n" in config
    (run / "config.yaml").write_text(config.replace("- 0.11\n", "- 0.95\n"))
    said = command("shoot-evaluate", run, "--out", tmp_path / "report.json")
    assert said.status == 2
    assert "would be black" in said.err
    assert not (tmp_path / "report.json").exists()
