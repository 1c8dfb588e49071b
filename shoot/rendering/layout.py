"""Where things stand on the page of a picture: a headline, the cameras, and room below."""

import textwrap
from dataclasses import dataclass
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from lss_core.config import CAMERAS
from shoot.rendering import palette

WIDTH_IN = 12.0
EDGE_IN = 0.15
GAP_IN = 0.06
TITLE_PT = 13.0
TITLE_LINE_IN = 0.26
CAPTION_LINE_IN = 0.25


class Page:
    """Places axes by inches from the upper left corner."""

    def __init__(self, width_in: float, height_in: float) -> None:
        self.width_in, self.height_in = width_in, height_in
        self.figure = Figure(figsize=(width_in, height_in), facecolor=palette.PAPER)

    def axes(self, left_in: float, top_in: float, width_in: float, height_in: float) -> Axes:
        """New axes there."""
        bottom_in = self.height_in - top_in - height_in
        return self.figure.add_axes(
            (
                left_in / self.width_in,
                bottom_in / self.height_in,
                width_in / self.width_in,
                height_in / self.height_in,
            )
        )

    def text(self, left_in: float, top_in: float, text: str, **style: Any) -> None:
        """Text whose upper left corner is there."""
        self.figure.text(
            left_in / self.width_in,
            1.0 - top_in / self.height_in,
            text,
            va="top",
            parse_math=False,  # a text of data may have dollars
            **style,
        )


def wrap(text: str, width_in: float, size_pt: float, is_bold: bool = False) -> list[str]:
    """Lines of a text that fit into a width, set in the figure's font at a size."""
    # Width of letters as a share of the size: averages of DejaVu Sans in prose, and some to spare.
    letter_pt = (0.68 if is_bold else 0.6) * size_pt
    return textwrap.wrap(text, max(1, int(width_in * 72.0 / letter_pt)))


def camera_places(names: tuple[str, ...]) -> tuple[list[tuple[int, int]], int, int]:
    """(row, column) of each camera, and the numbers of rows and columns.

    Cameras of nuScenes stand where they look: front row above, back row below, left on the left.
    Other rigs are filled in row by row.
    """
    if len(set(names)) == len(names) and set(names) <= set(CAMERAS):
        places = [divmod(CAMERAS.index(name), 3) for name in names]
        used = sorted({row for row, _ in places})
        return [(used.index(row), column) for row, column in places], len(used), 3
    columns = min(max(len(names), 1), 3 if len(names) <= 6 else 4)
    rows = -(-len(names) // columns)
    return [divmod(idx, columns) for idx in range(len(names))], rows, columns


@dataclass(frozen=True)
class CameraPage:
    """A page with its headline and empty panels for cameras.

    Attributes:
        page: The page.
        cameras: A panel for each camera, in their order.
        camera_width_in: Width of each panel.
        below_in: Where the rest begins, from above.
    """

    page: Page
    cameras: list[Axes]
    camera_width_in: float
    below_in: float


def lay_out_cameras(
    names: tuple[str, ...], image_hw: tuple[int, int], title: str, caption: str, rest_in: float
) -> CameraPage:
    """A page with title, caption and a panel for each camera.

    Args:
        names: Of the cameras.
        image_hw: Sides of all images.
        title: Headline, wrapped to as many lines as it needs.
        caption: Small print below it; none if empty.
        rest_in: Height of what stands below the cameras.
    """
    places, rows, columns = camera_places(names)
    width_in = (WIDTH_IN - 2 * EDGE_IN - (columns - 1) * GAP_IN) / columns
    height_in = width_in * image_hw[0] / image_hw[1]
    lines = wrap(title, WIDTH_IN - 2 * EDGE_IN, TITLE_PT, is_bold=True)
    title_in = TITLE_LINE_IN * len(lines)
    head_in = EDGE_IN + title_in + (CAPTION_LINE_IN if caption else 0.0)
    below_in = head_in + rows * (height_in + GAP_IN) + 0.12
    page = Page(WIDTH_IN, below_in + rest_in)
    bold = {"fontsize": TITLE_PT, "fontweight": "bold", "color": palette.INK}
    for number, line in enumerate(lines):
        page.text(EDGE_IN, 0.12 + number * TITLE_LINE_IN, line, **bold)
    if caption:
        page.text(EDGE_IN, 0.13 + title_in, caption, fontsize=10, color=palette.SOFT_INK)
    cameras = [
        page.axes(
            EDGE_IN + column * (width_in + GAP_IN),
            head_in + row * (height_in + GAP_IN),
            width_in,
            height_in,
        )
        for row, column in places
    ]
    return CameraPage(page, cameras, width_in, below_in)


def camera_label(name: str) -> str:
    """What stands in the corner of a camera's panel."""
    return name.removeprefix("CAM_").replace("_", " ").lower()
