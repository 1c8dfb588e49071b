import math
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from lss_core.config import ImageConfig
from lss_core.data.sensors.images import PixelMap, draw_pixel_map, load_image, open_image
from lss_core.errors import DataError

RAW_HW = (180, 320)


def picture_of_dots(centres: list[tuple[float, float]], raw_hw: tuple[int, int]) -> np.ndarray:
    """Soft white dots, wide enough to survive resampling."""
    rows, columns = np.mgrid[: raw_hw[0], : raw_hw[1]]
    picture = np.zeros(raw_hw)
    for u, v in centres:
        picture += np.exp(-((columns - u) ** 2 + (rows - v) ** 2) / (2.0 * 3.5**2))
    return np.repeat((255.0 * picture.clip(0.0, 1.0)).astype(np.uint8)[..., None], 3, axis=-1)


def centroid_near(picture: np.ndarray, place: np.ndarray, radius: int) -> np.ndarray:
    """Sub-pixel centre (u, v) of the light within a window."""
    light = picture[..., 0].astype(np.float64)
    rows, columns = np.mgrid[: light.shape[0], : light.shape[1]]
    light[np.hypot(columns - place[0], rows - place[1]) > radius] = 0.0
    assert light.sum() > 200.0, "no dot where it should be"
    return np.array([(light * columns).sum(), (light * rows).sum()]) / light.sum()


def a_map(
    resized_hw: tuple[int, int] = RAW_HW,
    left_px: int = 0,
    top_px: int = 0,
    flip: bool = False,
    rotate_rad: float = 0.0,
    image_hw: tuple[int, int] = RAW_HW,
) -> PixelMap:
    return PixelMap(resized_hw, left_px, top_px, flip, rotate_rad, image_hw, RAW_HW)


MAPS = {
    "nothing": a_map(),
    "smaller": a_map((90, 160), image_hw=(90, 160)),
    "much smaller": a_map((45, 80), image_hw=(45, 80)),
    "larger": a_map((261, 464), image_hw=(261, 464)),
    "unevenly": a_map((101, 143), image_hw=(101, 143)),
    "crop": a_map(left_px=23, top_px=41, image_hw=(120, 280)),
    "pad": a_map(left_px=-17, top_px=-9, image_hw=(200, 350)),
    "flip": a_map(flip=True),
    "flip odd crop": a_map(left_px=10, flip=True, image_hw=(180, 301)),
    "turn left": a_map(rotate_rad=0.2),
    "turn right, odd": a_map(rotate_rad=-0.15, image_hw=(171, 307)),
    "all": a_map((144, 256), 11, 20, True, 0.09, (110, 230)),
    "all with padding": a_map((144, 256), -5, -8, True, -0.12, (160, 270)),
}


@pytest.mark.parametrize("suffix", [".png", ".jpg"])
@pytest.mark.parametrize("name", MAPS)
def test_a_dot_goes_where_the_matrix_says(tmp_path: Path, name: str, suffix: str) -> None:
    pixel_map = MAPS[name]
    dots = [(160.3, 95.6), (75.0, 70.0), (236.7, 80.2), (120.0, 130.0)]
    path = tmp_path / f"dots{suffix}"
    Image.fromarray(picture_of_dots(dots, RAW_HW)).save(path, quality=95)
    loaded = load_image(path, pixel_map)
    assert loaded.shape == (*pixel_map.image_hw, 3)
    scale = pixel_map.resized_hw[1] / RAW_HW[1]
    for u, v in dots:
        expected = (pixel_map.pixel_from_rawpixel @ [u, v, 1.0])[:2]
        found = centroid_near(loaded, expected, math.ceil(11 * scale) + 1)
        assert np.abs(found - expected).max() < 0.3


def test_matrices_by_hand() -> None:
    # Half size: the outer edges meet, so pixel 0 of the file lies a quarter pixel before pixel 0.
    half = MAPS["smaller"].pixel_from_rawpixel
    np.testing.assert_allclose(half @ [0.0, 0.0, 1.0], [-0.25, -0.25, 1.0])
    np.testing.assert_allclose(half @ [319.0, 179.0, 1.0], [159.25, 89.25, 1.0])
    np.testing.assert_allclose(MAPS["crop"].pixel_from_rawpixel @ [23.0, 41.0, 1.0], [0, 0, 1])
    np.testing.assert_allclose(MAPS["flip"].pixel_from_rawpixel @ [0.0, 7.0, 1.0], [319, 7, 1])
    # A quarter turn counter-clockwise about the centre takes its right to its top.
    quarter = PixelMap((101, 101), 0, 0, False, math.pi / 2.0, (101, 101), (101, 101))
    np.testing.assert_allclose(
        quarter.pixel_from_rawpixel @ [80.0, 50.0, 1.0], [50.0, 20.0, 1.0], atol=1e-9
    )


def test_evaluation_map_by_hand() -> None:
    # 1600 x 900 at the paper's size: width fits at 0.22, so 352 x 198; 11 % of 198 rows are cut off
    # below and the rest of the 70 that are too many above.
    pixel_map = draw_pixel_map(ImageConfig(), (900, 1600), None)
    assert pixel_map.resized_hw == (198, 352)
    assert (pixel_map.left_px, pixel_map.top_px) == (0, 48)
    assert not pixel_map.flip
    assert pixel_map.rotate_rad == 0.0
    assert pixel_map == draw_pixel_map(ImageConfig(), (900, 1600), None)


def test_training_draws_within_their_bounds_and_differ() -> None:
    config = ImageConfig()
    drawn = [draw_pixel_map(config, (900, 1600), np.random.default_rng(i)) for i in range(200)]
    factors = np.array([m.resized_hw[1] / 352 for m in drawn])
    assert 0.875 < factors.min() < 0.9
    assert 1.0 < factors.max() < 1.025
    assert {m.flip for m in drawn} == {False, True}
    turns = np.array([m.rotate_rad for m in drawn])
    assert np.abs(turns).max() <= config.rotate_rad
    assert turns.min() < -0.08
    assert turns.max() > 0.08
    for m in drawn:
        cut_below = m.resized_hw[0] - m.top_px - 128
        assert -1 <= cut_below <= 0.22 * m.resized_hw[0] + 1
        spare = m.resized_hw[1] - 352
        assert min(0, spare) <= m.left_px <= max(0, spare)
    assert drawn[3] == draw_pixel_map(config, (900, 1600), np.random.default_rng(3))


def test_no_augmentation_where_none_is_asked_for() -> None:
    config = ImageConfig(resize=(1.0, 1.0), crop_bottom=(0.1, 0.1), rotate_rad=0.0, flip=False)
    plain = draw_pixel_map(config, (900, 1600), None)
    for seed in range(10):
        drawn = draw_pixel_map(config, (900, 1600), np.random.default_rng(seed))
        assert drawn.resized_hw == plain.resized_hw
        assert drawn.top_px == plain.top_px
        np.testing.assert_array_equal(drawn.pixel_from_rawpixel, plain.pixel_from_rawpixel)


def test_too_narrow_images_are_padded_alike_on_both_sides(tmp_path: Path) -> None:
    config = ImageConfig(
        height_px=40, width_px=100, resize=(0.8, 0.8), crop_bottom=(0.0, 0.0), rotate_rad=0.0
    )
    pixel_map = draw_pixel_map(config, (50, 100), np.random.default_rng(1))
    assert pixel_map.resized_hw == (40, 80)
    assert pixel_map.left_px == -10
    path = tmp_path / "white.png"
    Image.new("RGB", (100, 50), (255, 255, 255)).save(path)
    loaded = load_image(path, pixel_map)
    assert (loaded[:, 10:90] == 255).all()
    assert (loaded[:, :10] == 0).all()
    assert (loaded[:, 90:] == 0).all()


@pytest.mark.parametrize("fraction", [1, 2, 3, 4, 8])
def test_reduced_decoding_shows_nearly_the_same(tmp_path: Path, fraction: int) -> None:
    # An odd size, so that reduced decoding ends in a part of a pixel.
    rng = np.random.default_rng(0)
    blocks = Image.fromarray(rng.integers(0, 256, (9, 13, 3), dtype=np.uint8))
    picture = blocks.resize((811, 453), Image.Resampling.BICUBIC)
    picture.save(tmp_path / "p.jpg", quality=95)
    Image.open(tmp_path / "p.jpg").save(tmp_path / "p.png")  # decoded whole
    resized = round(453 / fraction), round(811 / fraction)
    pixel_map = PixelMap(resized, 0, 0, False, 0.0, resized, (453, 811))
    reduced = load_image(tmp_path / "p.jpg", pixel_map).astype(float)
    whole = load_image(tmp_path / "p.png", pixel_map).astype(float)
    assert np.abs(reduced - whole).mean() < 1.5
    assert np.abs(reduced - whole).max() < 40.0


@pytest.mark.parametrize(
    ("left", "top", "height", "width"),
    [(0, 0, 60, 100), (13, 7, 40, 70), (-9, 30, 50, 120), (60, -5, 20, 60), (140, 0, 30, 20)],
)
def test_cutting_before_resizing_is_cutting_after_it(
    tmp_path: Path, left: int, top: int, height: int, width: int
) -> None:
    noise = np.random.default_rng(0).integers(0, 256, (*RAW_HW, 3), dtype=np.uint8)
    Image.fromarray(noise).save(tmp_path / "p.png")
    resized = Image.fromarray(noise).resize((107, 60), Image.Resampling.BILINEAR)
    expected = np.asarray(resized.crop((left, top, left + width, top + height)))
    pixel_map = a_map((60, 107), left, top, image_hw=(height, width))
    cut = load_image(tmp_path / "p.png", pixel_map)
    assert cut.shape == (height, width, 3)
    assert np.abs(cut.astype(int) - expected).max() <= 1


def test_grey_images_become_rgb(tmp_path: Path) -> None:
    Image.new("L", (320, 180), 77).save(tmp_path / "grey.jpg")
    assert (load_image(tmp_path / "grey.jpg", MAPS["smaller"]) == 77).all()


def test_colours_keep_their_order(tmp_path: Path) -> None:
    Image.new("RGB", (320, 180), (200, 100, 0)).save(tmp_path / "c.png")
    assert load_image(tmp_path / "c.png", MAPS["smaller"])[40, 40].tolist() == [200, 100, 0]


def test_missing_image_is_named(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"'.*gone\.jpg' is missing"):
        open_image(tmp_path / "gone.jpg")


def test_no_image_at_all(tmp_path: Path) -> None:
    (tmp_path / "text.jpg").write_text("no image")
    with pytest.raises(DataError, match=r"'.*text\.jpg' is no JPEG or PNG"):
        open_image(tmp_path / "text.jpg")


@pytest.mark.parametrize("suffix", [".jpg", ".png"])
@pytest.mark.parametrize("share", [0.3, 0.6, 0.9])
def test_truncated_image_is_named(tmp_path: Path, suffix: str, share: float) -> None:
    rng = np.random.default_rng(0)
    path = tmp_path / f"cut{suffix}"
    Image.fromarray(rng.integers(0, 256, (*RAW_HW, 3), dtype=np.uint8)).save(path)
    whole = path.read_bytes()
    path.write_bytes(whole[: int(share * len(whole))])
    with pytest.raises(DataError, match=rf"'.*cut\{suffix}' is damaged"):
        load_image(path, MAPS["smaller"])


def test_image_of_another_size_is_named(tmp_path: Path) -> None:
    Image.new("RGB", (64, 36)).save(tmp_path / "small.jpg")
    with pytest.raises(DataError, match=r"small\.jpg' is 64x36 px, expected 320x180"):
        load_image(tmp_path / "small.jpg", MAPS["nothing"])


@pytest.mark.parametrize("suffix", [".jpg", ".png"])
def test_damaged_bytes_never_end_in_another_error(tmp_path: Path, suffix: str) -> None:
    rng = np.random.default_rng(0)
    path = tmp_path / f"bad{suffix}"
    Image.fromarray(rng.integers(0, 256, (18, 32, 3), dtype=np.uint8)).save(path)
    whole = path.read_bytes()
    pixel_map = PixelMap((18, 32), 0, 0, False, 0.0, (18, 32), (18, 32))
    refused = 0
    for place in range(0, min(len(whole), 700), 3):
        damaged = bytearray(whole)
        damaged[place] ^= 0x5A
        path.write_bytes(damaged)
        try:
            assert load_image(path, pixel_map).shape == (18, 32, 3)
        except DataError:
            refused += 1
    assert refused > 5
