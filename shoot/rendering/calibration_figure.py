"""A camera's calibration held against its images: horizon, driven path, and what the crop keeps."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, UInt8
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Polygon
from matplotlib.patheffects import Normal, Stroke

from lss_core.camera import horizon_line
from shoot.rendering import palette
from shoot.rendering.camera_panel import project_path
from shoot.rendering.line_style import driven_style
from shoot.rendering.sample_view import FloatArray, from_origin
from shoot.trajectories import HORIZON_S

_WIDTH_IN, _HEAD_IN, _FOOT_IN, _GAP_IN = 12.0, 0.45, 0.4, 0.08
_CASING = [Stroke(linewidth=3.0, foreground="#ffffffb0"), Normal()]
_HORIZON: dict[str, Any] = {"color": palette.PLANNED, "linewidth": 1.4, "path_effects": _CASING}
_CROP: dict[str, Any] = {"edgecolor": palette.INK, "linewidth": 1.2, "path_effects": _CASING}


@dataclass(frozen=True)
class CalibrationView:
    """One image and what its calibration says of it.

    Attributes:
        image: As it is shown.
        pixel_from_camera: Intrinsics of the image as it is shown.
        ego_from_camera: Camera pose, in the ego frame that `driven` starts in.
        driven: Where the ego goes next, metres in `ego`; None where that is not recorded.
        kept: Corners, in pixels, of what the network is given.
        label: Names the sample.
    """

    image: UInt8[np.ndarray[Any, np.dtype[np.uint8]], "H W 3"]
    pixel_from_camera: Float[FloatArray, "3 3"]
    ego_from_camera: Float[FloatArray, "4 4"]
    driven: Float[FloatArray, "T 2"] | None
    kept: Float[FloatArray, "4 2"]
    label: str


def render_calibration(views: Sequence[CalibrationView], title: str) -> Figure:
    """Images of one camera side by side; save the figure with `save_figure`.

    If calibration and poses are right, the orange line lies on the horizon, and the blue one on the
    road where the car will be.

    Args:
        views: One at least.
        title: Names the camera.
    """
    height, width = views[0].image.shape[:2]
    columns = min(len(views), 2 if width >= height else 4)
    rows = -(-len(views) // columns)
    cell_in = (_WIDTH_IN - (columns + 1) * _GAP_IN) / columns
    cell_height_in = cell_in * height / width
    height_in = _HEAD_IN + rows * (cell_height_in + _GAP_IN) + _FOOT_IN
    figure = Figure(figsize=(_WIDTH_IN, height_in), facecolor=palette.PAPER)
    for number, view in enumerate(views):
        row, column = divmod(number, columns)
        left_in = _GAP_IN + column * (cell_in + _GAP_IN)
        top_in = _HEAD_IN + row * (cell_height_in + _GAP_IN)
        axes = figure.add_axes(
            (
                left_in / _WIDTH_IN,
                1.0 - (top_in + cell_height_in) / height_in,
                cell_in / _WIDTH_IN,
                cell_height_in / height_in,
            )
        )
        _draw(axes, view)
    text: dict[str, Any] = {"color": palette.INK, "parse_math": False, "fontsize": 13}
    figure.text(0.008, 1.0 - 0.1 / height_in, title, va="top", fontweight="bold", **text)
    handles = [
        Line2D(
            [], [], label=f"driven in the next {HORIZON_S:g} s, on the ground", **driven_style(2.4)
        ),
        Line2D([], [], label="horizon by the calibration", **_HORIZON),
        Polygon([[0, 0]], fill=False, label="what the network is given", **_CROP),
    ]
    figure.legend(handles=handles, loc="lower center", ncols=3, frameon=False, fontsize=10)
    return figure


def _draw(axes: Axes, view: CalibrationView) -> None:
    height, width = view.image.shape[:2]
    axes.imshow(view.image, zorder=0)
    axes.set_xlim(-0.5, width - 0.5)
    axes.set_ylim(height - 0.5, -0.5)
    axes.set_axis_off()
    axes.add_patch(Polygon(view.kept, fill=False, zorder=2, gid="kept", **_CROP))
    across, down, constant = horizon_line(view.pixel_from_camera, view.ego_from_camera)
    if abs(down) > 1e-9:  # else it stands upright
        u_px = np.array([-0.5, width - 0.5])
        v_px = -(across * u_px + constant) / down
        axes.plot(u_px, v_px, zorder=3, gid="horizon", **_HORIZON)
    if view.driven is not None:
        camera = view.pixel_from_camera, view.ego_from_camera
        for pixels in project_path(from_origin(view.driven), *camera, (height, width)):
            axes.plot(*pixels.T, zorder=4, gid="driven", **driven_style(2.4))
    axes.text(
        0.012,
        0.97,
        view.label,
        parse_math=False,
        transform=axes.transAxes,
        va="top",
        fontsize=9,
        color="white",
        path_effects=[Stroke(linewidth=2.5, foreground="#000000b0"), Normal()],
        zorder=6,
    )
