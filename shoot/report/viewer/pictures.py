"""Pictures as texts that stand inside a page: cost maps, scans from above, images of a size."""

import base64
import io
from typing import Any, Final

import numpy as np
from jaxtyping import Float, UInt8
from PIL import Image

from lss_core.grid import BevGrid
from shoot.rendering import palette
from shoot.rendering.sample_view import FloatArray

# Fewer levels than an eye could tell apart make smaller files than all 256.
_LEVELS: Final = 64
_POINT_CELL_M: Final = 0.25
# Width and JPEG quality, best first; the last is taken whatever its size.
_SIZES: Final = (
    (800, 85), (800, 75), (640, 75), (640, 60), (480, 60), (400, 50), (320, 45), (240, 40),
    (160, 30),
)  # fmt: skip


def image_within(image: UInt8[np.ndarray[Any, np.dtype[np.uint8]], "H W 3"], budget: int) -> str:
    """An image as a JPEG, as large and good as a number of bytes allows.

    Args:
        image: RGB; is made smaller where that helps, never larger.
        budget: Bytes that the text may have.
    """
    whole = Image.fromarray(image)
    text = ""
    for width_px, quality in _SIZES:
        scale = min(1.0, width_px / whole.width)
        sides = max(1, round(whole.width * scale)), max(1, round(whole.height * scale))
        shown = whole if scale == 1.0 else whole.resize(sides, Image.Resampling.LANCZOS)
        text = _inline(shown, "JPEG", quality=quality, optimize=True)
        if len(text) <= budget:
            break
    return text


def cost_picture(cost_map: Float[FloatArray, "X Y"], low: float, high: float) -> str:
    """A cost map from above, forward up, one pixel a cell, as a PNG.

    Args:
        cost_map: X forward, Y left.
        low: Cost that is white.
        high: Cost that is dark.
    """
    share = np.clip((cost_map - low) / (high - low), 0.0, 1.0)
    levels = np.rint(share * (_LEVELS - 1)).astype(np.uint8)
    colours = palette.COST(np.linspace(0.0, 1.0, _LEVELS))[:, :3]
    return _from_above(levels, (255.0 * colours).round().astype(np.uint8))


def points_picture(points_m: Float[FloatArray, "P 3"], grid: BevGrid) -> str:
    """Points from above, forward up, as a PNG that is clear where there are none.

    Args:
        points_m: In `ego`, in metres.
        grid: What the picture covers.
    """
    low = np.array([grid.x_min_m, grid.y_min_m])
    size_m = np.array([grid.x_max_m, grid.y_max_m]) - low
    cells = np.floor((points_m[:, :2] - low) / _POINT_CELL_M).astype(np.int64)
    shape = np.ceil(size_m / _POINT_CELL_M).astype(np.int64)
    inside = cells[((cells >= 0) & (cells < shape)).all(axis=1)]
    is_hit = np.zeros(tuple(shape), dtype=np.uint8)
    is_hit[inside[:, 0], inside[:, 1]] = 1
    ink = [int(palette.INK[place : place + 2], 16) for place in (1, 3, 5)]
    return _from_above(is_hit, np.array([[255, 255, 255], ink], dtype=np.uint8), transparency=0)


def _from_above(
    levels: UInt8[np.ndarray[Any, np.dtype[np.uint8]], "X Y"],
    colours: UInt8[np.ndarray[Any, np.dtype[np.uint8]], "L 3"],
    **options: Any,
) -> str:
    """Cells by the number of their colour."""
    picture = Image.fromarray(np.ascontiguousarray(levels[::-1, ::-1]), mode="P")
    picture.putpalette(colours.tobytes())
    return _inline(picture, "PNG", optimize=True, **options)


def _inline(picture: Image.Image, kind: str, **options: Any) -> str:
    stream = io.BytesIO()
    picture.save(stream, kind, **options)
    return f"data:image/{kind.lower()};base64,{base64.b64encode(stream.getvalue()).decode()}"
