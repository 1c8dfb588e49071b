"""An image in its panel, and which points on the ground it shows."""

from typing import Any

import numpy as np
from jaxtyping import Float, UInt8
from matplotlib.axes import Axes
from matplotlib.patheffects import Normal, Stroke
from numpy.typing import NDArray

from shoot.rendering.sample_view import FloatArray

NEAR_M = 0.5


def draw_image(
    axes: Axes, image: UInt8[np.ndarray[Any, np.dtype[np.uint8]], "H W 3"], label: str
) -> None:
    """Fill the panel with an image, its name in the corner; axes are pixels."""
    height, width = image.shape[:2]
    axes.imshow(image, interpolation="bicubic" if width < 600 else "antialiased", zorder=0)
    axes.set_xlim(-0.5, width - 0.5)
    axes.set_ylim(height - 0.5, -0.5)
    axes.set_axis_off()
    axes.text(
        0.012,
        0.97,
        label,
        parse_math=False,  # a camera may have dollars in its name
        transform=axes.transAxes,
        va="top",
        ha="left",
        fontsize=10.5,
        color="white",
        fontweight="bold",
        path_effects=[Stroke(linewidth=2.5, foreground="#000000b0"), Normal()],
        zorder=6,
    )


def where_seen(
    pixels: Float[FloatArray, "*S 2"],
    depth_m: Float[FloatArray, "*S"],
    image_hw: tuple[int, int],
    near_m: float = NEAR_M,
) -> NDArray[np.bool_]:
    """Which points are in front of the camera and inside its image."""
    height, width = image_hw
    inside: NDArray[np.bool_] = (
        (depth_m >= near_m)
        & (pixels[..., 0] >= -0.5)
        & (pixels[..., 0] <= width - 0.5)
        & (pixels[..., 1] >= -0.5)
        & (pixels[..., 1] <= height - 0.5)
    )
    return inside
