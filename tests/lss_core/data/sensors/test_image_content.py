"""Image files that would be read as something else than their camera saw are refused."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from lss_core.data.sensors.file_checks import image_problem
from lss_core.data.sensors.images import PixelMap, load_image
from lss_core.errors import DataError

HW = (18, 32)
WHOLE = PixelMap(HW, 0, 0, False, 0.0, HW, HW)


def refusal(path: Path) -> str:
    """What loading says; looking at the header, as --data.skip-bad does, says the same."""
    with pytest.raises(DataError) as caught:
        load_image(path, WHOLE)
    problem = image_problem(path, HW)
    assert problem is not None
    assert problem.reason == "image of another kind"
    assert problem.what == str(caught.value)
    assert str(path) in problem.what
    return problem.what


@pytest.mark.parametrize("highest", [65535, 4095, 300])
def test_16_bit_grey_is_not_clipped_to_white(tmp_path: Path, highest: int) -> None:
    ramp = np.linspace(0, highest, HW[0] * HW[1]).astype(np.uint16).reshape(HW)
    Image.fromarray(ramp).save(tmp_path / "deep.png")
    assert "16-bit grey (mode I" in refusal(tmp_path / "deep.png")
    assert "8 bits" in refusal(tmp_path / "deep.png")


def test_16_bit_colour_is_not_read_as_if_all_its_bits_were_used(tmp_path: Path) -> None:
    cv2 = pytest.importorskip("cv2")
    # 12 bits of a camera, stored in 16: the upper halves of them would be all but black.
    assert cv2.imwrite(str(tmp_path / "deep.png"), np.full((*HW, 3), 4095, dtype=np.uint16))
    assert "16-bit colour" in refusal(tmp_path / "deep.png")


def test_12_bit_jpeg_is_no_image(tmp_path: Path) -> None:
    Image.new("RGB", HW[::-1]).save(tmp_path / "p.jpg")
    data = bytearray((tmp_path / "p.jpg").read_bytes())
    data[data.index(b"\xff\xc0") + 4] = 12
    (tmp_path / "p.jpg").write_bytes(data)
    with pytest.raises(DataError, match=r"p\.jpg' is no JPEG or PNG"):
        load_image(tmp_path / "p.jpg", WHOLE)
    assert image_problem(tmp_path / "p.jpg", HW) is not None


def test_animations_are_refused(tmp_path: Path) -> None:
    frames = [Image.new("RGB", HW[::-1], (level, 0, 0)) for level in (10, 90, 200)]
    frames[0].save(tmp_path / "moving.png", save_all=True, append_images=frames[1:])
    assert "3 frames" in refusal(tmp_path / "moving.png")


def save_oriented(path: Path, orientation: int) -> None:
    exif = Image.Exif()
    exif[0x0112] = orientation
    Image.new("RGB", HW[::-1], (90, 120, 60)).save(path, exif=exif, quality=95)


@pytest.mark.parametrize("suffix", [".jpg", ".png"])
@pytest.mark.parametrize("orientation", range(2, 9))
def test_turned_by_exif_is_refused(tmp_path: Path, suffix: str, orientation: int) -> None:
    path = tmp_path / f"turned{suffix}"
    save_oriented(path, orientation)
    assert f"EXIF orientation {orientation}" in refusal(path)
    # Whichever way round the tables have the sides, the tag is what is said.
    upright = PixelMap(HW[::-1], 0, 0, False, 0.0, HW[::-1], HW[::-1])
    with pytest.raises(DataError, match="EXIF orientation"):
        load_image(path, upright)


@pytest.mark.parametrize("suffix", [".jpg", ".png"])
@pytest.mark.parametrize("orientation", [0, 1, 9])
def test_exif_that_turns_nothing_is_read(tmp_path: Path, suffix: str, orientation: int) -> None:
    path = tmp_path / f"plain{suffix}"
    save_oriented(path, orientation)
    assert np.abs(load_image(path, WHOLE).astype(int) - [90, 120, 60]).max() <= 3
    assert image_problem(path, HW) is None


def test_exif_that_is_no_exif_is_read(tmp_path: Path) -> None:
    path = tmp_path / "odd.jpg"
    Image.new("RGB", HW[::-1], (90, 120, 60)).save(path, exif=b"Exif\0\0no such thing")
    assert load_image(path, WHOLE).shape == (*HW, 3)
    assert image_problem(path, HW) is None


@pytest.mark.parametrize(
    ("mode", "colour", "name", "expected"),
    [
        ("1", 1, "p.png", [255, 255, 255]),
        ("L", 77, "p.jpg", [77, 77, 77]),
        ("L", 77, "p.png", [77, 77, 77]),
        ("LA", (77, 255), "p.png", [77, 77, 77]),
        ("RGB", (200, 100, 0), "p.jpg", [200, 100, 0]),
        ("RGBA", (200, 100, 0, 255), "p.png", [200, 100, 0]),
        ("RGBA", (200, 100, 0, 60), "p.png", [200, 100, 0]),
        ("CMYK", (55, 155, 255, 0), "p.jpg", [200, 100, 0]),
    ],
)
def test_8_bits_a_channel_are_read_as_they_are(
    tmp_path: Path, mode: str, colour: int | tuple[int, ...], name: str, expected: list[int]
) -> None:
    Image.new(mode, HW[::-1], colour).save(tmp_path / name, quality=95)
    assert np.abs(load_image(tmp_path / name, WHOLE).astype(int) - expected).max() <= 4
    assert image_problem(tmp_path / name, HW) is None


def test_palettes_are_read_as_their_colours(tmp_path: Path) -> None:
    picture = Image.new("P", HW[::-1], 1)
    picture.putpalette([0, 0, 0, 200, 100, 0])
    picture.save(tmp_path / "p.png")
    assert (load_image(tmp_path / "p.png", WHOLE) == [200, 100, 0]).all()
