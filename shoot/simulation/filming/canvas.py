"""A picture to draw on: smooth shapes, and text."""

from functools import lru_cache
from pathlib import Path
from typing import Any, Literal

import cv2
import matplotlib as mpl
import numpy as np
import shapely
from matplotlib.colors import to_rgb
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from lss_core.legible import legible

Rgb = NDArray[np.uint8]
Points = NDArray[np.floating[Any]]

# Corners are given to OpenCV as whole numbers of such parts of a pixel.
_SHIFT = 4


def colour(name: str) -> tuple[int, int, int]:
    """Red, green and blue, 0 to 255, of a colour as matplotlib names it."""
    red, green, blue = (round(255 * part) for part in to_rgb(name))
    return red, green, blue


@lru_cache(maxsize=32)
def _font(size_px: int, is_bold: bool) -> ImageFont.FreeTypeFont:
    """Matplotlib's own font, which is the same on all machines."""
    name = "DejaVuSans-Bold.ttf" if is_bold else "DejaVuSans.ttf"
    path = Path(mpl.get_data_path()) / "fonts" / "ttf" / name
    return ImageFont.truetype(str(path), size_px, layout_engine=ImageFont.Layout.BASIC)


def text_width(text: str, size_px: int, is_bold: bool = False) -> float:
    """How wide a line of text is, in pixels."""
    return float(_font(size_px, is_bold).getlength(legible(text)))


class Canvas:
    """Pixels that shapes are drawn on; texts lie on top of all shapes.

    Coordinates are pixels, x to the right and y down; whole numbers are middles of pixels. What
    lies outside is cut off.

    Args:
        rgb: [H, W, 3] what is there first; it is copied.
    """

    def __init__(self, rgb: Rgb) -> None:
        self._rgb = np.ascontiguousarray(rgb).copy()
        self._texts: list[tuple[float | int, float | int, str, int, str, bool, str]] = []

    @classmethod
    def blank(cls, width_px: int, height_px: int, background: str) -> "Canvas":
        """A picture of one colour."""
        return cls(np.full((height_px, width_px, 3), colour(background), np.uint8))

    @property
    def size(self) -> tuple[int, int]:
        """Width and height in pixels."""
        return self._rgb.shape[1], self._rgb.shape[0]

    def fill(self, rings: list[Points], fill: str, opacity: float = 1.0) -> None:
        """A surface; where rings lie in one another, the inner one is a hole."""
        fixed = [_fixed(ring) for ring in rings if len(ring) >= 3]
        if not fixed:
            return
        if opacity >= 1.0:
            cv2.fillPoly(self._rgb, fixed, colour(fill), cv2.LINE_AA, _SHIFT)
            return
        over = self._rgb.copy()
        cv2.fillPoly(over, fixed, colour(fill), cv2.LINE_AA, _SHIFT)
        cv2.addWeighted(over, opacity, self._rgb, 1.0 - opacity, 0.0, dst=self._rgb)

    def line(self, points: Points, stroke: str, width_px: int = 1, casing: str = "") -> None:
        """A line through points, on a wider one of another colour if there is a casing."""
        if len(points) < 2:
            return
        if casing:
            self.line(points, casing, width_px + 3)
        cv2.polylines(
            self._rgb, [_fixed(points)], False, colour(stroke), width_px, cv2.LINE_AA, _SHIFT
        )

    def dot(self, at: Points, radius_px: float, fill: str, edge: str = "") -> None:
        """A disc, with a thin edge if that has a colour."""
        centre = tuple(int(part) for part in _fixed(at))
        if max(abs(part) for part in centre) >= 2**20:
            return
        radius = round(radius_px * 2**_SHIFT)
        cv2.circle(self._rgb, centre, radius, colour(fill), cv2.FILLED, cv2.LINE_AA, _SHIFT)
        if edge:
            cv2.circle(self._rgb, centre, radius, colour(edge), 1, cv2.LINE_AA, _SHIFT)

    def text(
        self,
        x: float | int,
        y: float | int,
        text: str,
        size_px: int,
        ink: str,
        is_bold: bool = False,
        casing: str = "",
    ) -> None:
        """A line of text that begins at x and stands on y."""
        self._texts.append((x, y, legible(text), size_px, ink, is_bold, casing))

    def paste(self, rgb: Rgb, left: int, top: int) -> None:
        """Another picture, whole, with its upper left corner there."""
        self._rgb[top : top + rgb.shape[0], left : left + rgb.shape[1]] = rgb

    def picture(self) -> Rgb:
        """[H, W, 3] what has been drawn."""
        if not self._texts:
            return self._rgb.copy()
        image = Image.fromarray(self._rgb)
        pen = ImageDraw.Draw(image)
        anchor: Literal["ls"] = "ls"
        for x, y, text, size_px, ink, is_bold, casing in self._texts:
            edge: dict[str, Any] = {"stroke_width": 2, "stroke_fill": casing} if casing else {}
            pen.text((x, y), text, ink, _font(size_px, is_bold), anchor=anchor, **edge)
        return np.asarray(image)


def rings_of(geometry: shapely.Geometry) -> list[Points]:
    """Edges of all polygons of a geometry, those of holes included."""
    polygons = [g for g in shapely.get_parts(geometry) if isinstance(g, shapely.Polygon)]
    return [
        np.asarray(ring.coords)[:, :2]
        for polygon in polygons
        for ring in (polygon.exterior, *polygon.interiors)
        if not polygon.is_empty
    ]


def _fixed(points: Points) -> NDArray[np.int32]:
    fixed: NDArray[np.int32] = np.round(points * 2**_SHIFT).astype(np.int32)
    return fixed
