"""Image files to network input, together with the pixel map that was applied."""

import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError

from lss_core.camera import crop_map, flip_map, resize_map, rotate_map
from lss_core.config import ImageConfig
from lss_core.data.sensors.image_content import DAMAGE, content_problem
from lss_core.errors import DataError
from lss_core.geometry import FloatArray

# Fixed here because resampling filters change accuracy between library versions.
_FILTER = Image.Resampling.BILINEAR
_FORMATS = ("JPEG", "PNG")
# Pillow has a limit, too, but libraries change it for the whole process, as nuscenes-devkit does.
_MAX_PIXELS = 1 << 27


@dataclass(frozen=True)
class PixelMap:
    """What is done to one image on its way into the network.

    Attributes:
        resized_hw: Size of the whole image after resizing.
        left_px: Column of the resized image that becomes column 0; negative pads.
        top_px: Row of the resized image that becomes row 0; negative pads.
        flip: Whether it is mirrored then.
        rotate_rad: Turn about the centre after that, counter-clockwise.
        image_hw: Size of the result.
        raw_hw: Size of the image on disk.
    """

    resized_hw: tuple[int, int]
    left_px: int
    top_px: int
    flip: bool
    rotate_rad: float
    image_hw: tuple[int, int]
    raw_hw: tuple[int, int]

    @property
    def pixel_from_rawpixel(self) -> FloatArray:
        """[3, 3] where a pixel of the file ends up."""
        scale_y, scale_x = (
            new / old for new, old in zip(self.resized_hw, self.raw_hw, strict=True)
        )
        matrix = crop_map(self.left_px, self.top_px) @ resize_map(scale_x, scale_y)
        if self.flip:
            matrix = flip_map(self.image_hw[1]) @ matrix
        if self.rotate_rad:
            matrix = rotate_map(self.rotate_rad, self.image_hw) @ matrix
        return matrix

    @property
    def padding(self) -> float:
        """Share of the result that comes from no pixel of the file and is black, before turning."""
        (height, width), (resized_h, resized_w) = self.image_hw, self.resized_hw
        rows = min(self.top_px + height, resized_h) - max(self.top_px, 0)
        columns = min(self.left_px + width, resized_w) - max(self.left_px, 0)
        return 1.0 - max(rows, 0) * max(columns, 0) / (height * width)


def draw_pixel_map(
    config: ImageConfig,
    raw_hw: tuple[int, int],
    rng: np.random.Generator | None,
    horizon_row: float | None = None,
) -> PixelMap:
    """Choose resize, crop, flip and rotation; without `rng` the ones of evaluation.

    Paper: section 4.1 (128 x 352 after resize and crop, calibration adjusted). Deviation: crops
    keep the horizon, see docs/deviations.md.

    Args:
        config: What to choose from.
        raw_hw: Size of the image file.
        rng: Source of the choice. What is drawn from it does not depend on the horizon.
        horizon_row: Of the image file, `lss_core.camera.horizon_row`; None: not known.
    """
    if rng is None:
        factor, bottom, across, flip, angle = 1.0, sum(config.crop_bottom) / 2, 0.5, False, 0.0
    else:
        factor = rng.uniform(*config.resize)
        bottom = rng.uniform(*config.crop_bottom)
        across = rng.uniform()
        flip = config.flip and bool(rng.integers(2))
        angle = rng.uniform(-config.rotate_rad, config.rotate_rad)
    pixel_map = upright_map(config, raw_hw, factor, bottom, across, horizon_row)
    return replace(pixel_map, flip=flip, rotate_rad=angle)


def upright_map(
    config: ImageConfig,
    raw_hw: tuple[int, int],
    factor: float,
    bottom: float,
    across: float = 0.5,
    horizon_row: float | None = None,
) -> PixelMap:
    """Resize and crop with one choice of numbers, neither mirrored nor turned.

    Args:
        config: Size of the result, and what it keeps of the horizon.
        raw_hw: Size of the image file.
        factor: Of resizing, relative to the factor at which the file fills the result.
        bottom: Share of the resized image cut off below.
        across: Share cut off on the left of what is too much in width.
        horizon_row: As in `draw_pixel_map`.
    """
    raw_h, raw_w = raw_hw
    height, width = config.height_px, config.width_px
    fit = max(width / raw_w, height / raw_h)
    resized = max(1, round(raw_h * fit * factor)), max(1, round(raw_w * fit * factor))
    spare_w = resized[1] - width
    # Where the image is narrower than the network's, both sides are padded alike.
    left = round(across * spare_w) if spare_w > 0 else spare_w // 2
    top = round((1.0 - bottom) * resized[0]) - height
    if horizon_row is not None and -0.5 <= horizon_row <= raw_h - 0.5:
        horizon_px = (horizon_row + 0.5) / raw_h * resized[0]
        top = _top_with_horizon(top, resized[0] - height, horizon_px, config)
    return PixelMap(resized, left, top, False, 0.0, (height, width), raw_hw)


def _top_with_horizon(top: int, spare: int, horizon_px: float, config: ImageConfig) -> int:
    """The first row of a crop, moved no further than the horizon and the image's borders ask for.

    Args:
        top: First row of the crop as drawn.
        spare: The last first row of a crop within the image.
        horizon_px: How far below the upper edge of the resized image the horizon lies.
        config: Height of the crop, and which shares of it are to lie above and below the horizon.
    """
    if not 0 <= top <= spare:
        return top  # What pads shows the image's border; moving it would hide what settings do.
    above, below = (share * config.height_px for share in config.horizon)
    earliest = math.ceil(horizon_px + below) - config.height_px
    latest = max(earliest, math.floor(horizon_px - above))
    return min(max(top, earliest, 0), max(latest, 0), spare)


def open_image(path: Path) -> Image.Image:
    """The image file, a JPEG or PNG, not yet decoded.

    Raises:
        DataError: If it is missing or no such image.
    """
    try:
        # Of what else Pillow opens some is handed to other programs.
        image = Image.open(path, formats=_FORMATS)
    except FileNotFoundError as error:
        raise DataError(f"The image '{path}' is missing; is the data set complete?") from error
    except UnidentifiedImageError as error:
        raise DataError(f"The image '{path}' is no JPEG or PNG, or is damaged.") from error
    except (*DAMAGE, Image.DecompressionBombError) as error:
        raise DataError(f"The image '{path}' cannot be read: {error}.") from error
    width, height = image.size
    if width * height > _MAX_PIXELS:
        raise DataError(f"The image '{path}' cannot be read: it claims {width}x{height} px.")
    return image


def load_image(path: Path, pixel_map: PixelMap) -> NDArray[np.uint8]:
    """[H, W, 3] RGB after the pixel map; decoded at reduced scale where that loses nothing.

    Raises:
        DataError: If the file is missing, truncated, not of the size the map was made for, or of a
            kind that is not read, see `content_problem`.
    """
    image = open_image(path)
    problem = content_problem(image, path)
    if problem is not None:
        raise DataError(problem.what)
    raw_h, raw_w = pixel_map.raw_hw
    if image.size != (raw_w, raw_h):
        raise DataError(
            f"The image '{path}' is {image.size[0]}x{image.size[1]} px, expected {raw_w}x{raw_h}."
        )
    try:
        return fit_image(image, pixel_map)
    except DAMAGE as error:
        raise DataError(f"The image '{path}' is damaged: {error}.") from error


def fit_image(image: Image.Image, pixel_map: PixelMap) -> NDArray[np.uint8]:
    """[H, W, 3] RGB of an opened image after the pixel map.

    Args:
        image: Of the size that the map was made for, not yet decoded.
        pixel_map: What is done to it.

    Raises:
        OSError: If it is truncated; other damage may raise what Pillow raises.
    """
    raw_h, raw_w = pixel_map.raw_hw
    resized_h, resized_w = pixel_map.resized_hw
    image.draft("RGB", (resized_w, resized_h))
    reduced = round(raw_w / image.size[0])  # a JPEG decodes at 1/1, 1/2, 1/4 or 1/8
    # Only what is kept is resized, on the same raster as the whole image would be.
    kept = _kept(pixel_map)
    across, down = raw_w / reduced, raw_h / reduced
    box = (
        kept[0] / resized_w * across,
        kept[1] / resized_h * down,
        kept[2] / resized_w * across,
        kept[3] / resized_h * down,
    )
    image = image if image.mode == "RGB" else image.convert("RGB")
    image = image.resize((kept[2] - kept[0], kept[3] - kept[1]), _FILTER, box=box)
    height, width = pixel_map.image_hw
    left, top = pixel_map.left_px - kept[0], pixel_map.top_px - kept[1]
    if (left, top, width, height) != (0, 0, *image.size):  # pads
        image = image.crop((left, top, left + width, top + height))
    if pixel_map.flip:
        image = image.transpose(Image.Transpose.FLIP_LEFT_RIGHT)
    if pixel_map.rotate_rad:
        image = image.rotate(math.degrees(pixel_map.rotate_rad), _FILTER)
    return np.asarray(image)


def _kept(pixel_map: PixelMap) -> tuple[int, int, int, int]:
    """Left, upper, right and lower border of what the crop keeps of the resized image."""
    (height, width), (resized_h, resized_w) = pixel_map.image_hw, pixel_map.resized_hw
    left, right = (
        min(max(side, 0), resized_w) for side in (pixel_map.left_px, pixel_map.left_px + width)
    )
    upper, lower = (
        min(max(side, 0), resized_h) for side in (pixel_map.top_px, pixel_map.top_px + height)
    )
    # A crop beside the image keeps nothing of it; one pixel stands for it and falls to the padding.
    left, upper = min(left, resized_w - 1), min(upper, resized_h - 1)
    return left, upper, max(right, left + 1), max(lower, upper + 1)
