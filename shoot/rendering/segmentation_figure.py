"""One sample's segmentation in one picture: dots on the images, the map, and the truth beside it.

Paper: figure 1 (predictions in colours from above, and drawn back onto the images).
"""

import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from lss_core.camera import project
from lss_core.grid import BevGrid
from shoot.rendering import palette
from shoot.rendering.bev_panel import Extent, draw_ego, draw_scale_bar
from shoot.rendering.image_panel import draw_image, where_seen
from shoot.rendering.layout import WIDTH_IN, camera_label, lay_out_cameras
from shoot.rendering.sample_view import FloatArray
from shoot.rendering.segmentation_view import (
    SegmentationView,
    blend_classes,
    class_colour,
    topmost_class,
)

MAP_IN = 5.0
LEFT_IN = 0.72
# A dot is half as wide as its cell is where it is seen, within these bounds.
DOT_PT = (0.8, 7.0)


def render_segmentation(view: SegmentationView) -> Figure:
    """Picture of one sample: cameras with dots on top, the predicted and the true map below.

    A dot lies on the ground (z = 0 in `ego`) in the centre of each cell that is said to be of a
    class. In the predicted map colours fade with the probability. Forward is up, left is left.
    """
    image_hw = (int(view.images.shape[1]), int(view.images.shape[2]))
    laid_out = lay_out_cameras(
        view.camera_names, image_hw, view.title, view.caption, rest_in=0.3 + MAP_IN + 0.95
    )
    pt_per_px = 72.0 * laid_out.camera_width_in / image_hw[1]
    for idx, axes in enumerate(laid_out.cameras):
        draw_image(axes, view.images[idx], camera_label(view.camera_names[idx]))
        _draw_dots(axes, view, idx, pt_per_px)
    page, top_in = laid_out.page, laid_out.below_in + 0.3
    for left_in, name, values in (
        (LEFT_IN, "predicted", view.probabilities),
        (WIDTH_IN / 2 + LEFT_IN, "true", view.truth.astype(np.float64)),
    ):
        axes = page.axes(left_in, top_in, MAP_IN, MAP_IN)
        axes.set_title(name, fontsize=12)
        axes.set_anchor("N")
        draw_classes(axes, view.grid, view.classes, values)
        axes.tick_params(labelsize=10, length=3)
        axes.set_xlabel("y: left (m)", fontsize=10.5)
        axes.set_ylabel("x: forward (m)", fontsize=10.5)
    page.figure.legend(
        handles=[
            *(
                Patch(facecolor=class_colour(name), label=_describe(view, c))
                for c, name in enumerate(view.classes)
            ),
            Patch(facecolor=palette.EGO, label="ego vehicle"),
        ],
        loc="lower center",
        ncols=min(len(view.classes) + 1, 5),
        frameon=False,
        fontsize=10.5,
        handlelength=1.6,
        columnspacing=1.6,
        borderaxespad=0.2,
    )
    return page.figure


def _draw_dots(axes: Axes, view: SegmentationView, camera_idx: int, pt_per_px: float) -> None:
    """The cells that the camera sees, far ones first."""
    pixel_from_camera = view.pixel_from_camera[camera_idx]
    top = topmost_class(view.probabilities, view.classes, view.threshold).ravel()
    centres = view.grid.centres().double().numpy().reshape(-1, 2)[top >= 0]
    ground = np.concatenate([centres, np.zeros((len(centres), 1))], axis=-1)
    pixels, depth_m = project(ground, pixel_from_camera, view.ego_from_camera[camera_idx])
    height, width = view.images.shape[1:3]
    seen = where_seen(pixels, depth_m, (height, width))
    order = np.flatnonzero(seen)[np.argsort(-depth_m[seen])]
    width_px = 0.5 * view.grid.cell_m * pixel_from_camera[0, 0] / depth_m[order]
    colours = np.array([class_colour(name) for name in view.classes])
    axes.scatter(
        pixels[order, 0],
        pixels[order, 1],
        s=np.clip(pt_per_px * width_px, *DOT_PT) ** 2,
        c=colours[top[top >= 0][order]].tolist(),
        alpha=0.75,
        linewidths=0,
        zorder=2,
        gid="cells",
    )


def draw_classes(
    axes: Axes, grid: BevGrid, classes: Sequence[str], values: Float[FloatArray, "C X Y"]
) -> None:
    """A map in the colours of its classes, with the ego vehicle and a scale; forward is up."""
    axes.imshow(
        np.clip(blend_classes(values, classes), 0.0, 1.0),
        origin="lower",
        extent=(grid.y_min_m, grid.y_max_m, grid.x_min_m, grid.x_max_m),
        interpolation="nearest",
        zorder=0,
    )
    axes.set_xlim(grid.y_max_m, grid.y_min_m)  # y points left, so it grows to the left
    axes.set_ylim(grid.x_min_m, grid.x_max_m)
    draw_ego(axes)
    draw_scale_bar(axes, Extent(grid.x_min_m, grid.x_max_m, grid.y_min_m, grid.y_max_m), 10.0)


def _describe(view: SegmentationView, c: int) -> str:
    """Name of a class, and the IoU it has on this sample alone."""
    name, iou = view.classes[c].replace("_", " "), view.iou[c]
    return name if math.isnan(iou) else f"{name}: IoU {iou:.0f} %"
