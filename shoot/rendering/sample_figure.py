"""One sample in one picture: what the cameras see, what the map costs, what is planned and driven.

Paper: figure 11 (ten best-ranked trajectories), with the camera images beside the map.
"""

from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from shoot.rendering import palette
from shoot.rendering.bev_panel import (
    Extent,
    all_paths,
    close_extent,
    draw_bev,
    frame_close_up,
    whole_extent,
)
from shoot.rendering.camera_panel import LIDAR_DEPTH_M, draw_camera
from shoot.rendering.layout import EDGE_IN, WIDTH_IN, camera_label, lay_out_cameras, wrap
from shoot.rendering.line_style import driven_style
from shoot.rendering.rank_panel import describe_driven, draw_ranks
from shoot.rendering.sample_view import Ranking, SampleView, rank

MAP_IN = 4.7
CLOSE_IN = 2.3


def render_sample(view: SampleView) -> Figure:
    """Picture of one sample: camera images on top, the map and the ranking below.

    In the images the planned and the driven paths lie on the ground plane (z = 0 in `ego`); on the
    map forward is up and left is left. Save it with `save_figure`.
    """
    ranking = rank(view)
    image_hw = view.images.shape[1:3]
    laid_out = lay_out_cameras(
        view.camera_names, image_hw, view.title, view.caption, rest_in=MAP_IN + 0.88
    )
    page, map_top_in = laid_out.page, laid_out.below_in
    for idx, axes in enumerate(laid_out.cameras):
        draw_camera(axes, view, idx, ranking, camera_label(view.camera_names[idx]))

    paths_m = all_paths(view, ranking)
    whole = whole_extent(view.grid, paths_m)
    map_axes = page.axes(0.72, map_top_in, MAP_IN, MAP_IN)
    map_axes.set_anchor("N")
    cost_image = draw_bev(map_axes, view, ranking, whole)
    map_axes.set_xlabel("y: left (m)", fontsize=10.5)
    map_axes.set_ylabel("x: forward (m)", fontsize=10.5)
    side_in = 0.72 + MAP_IN + 0.12
    if cost_image is not None:
        _draw_cost_bar(page.axes(side_in, map_top_in + 0.42, 0.16, MAP_IN - 0.84), cost_image)
        side_in += 0.62
    side_in += 0.42
    if paths_m:
        close = close_extent(paths_m, CLOSE_IN / MAP_IN)
        close_axes = page.axes(side_in, map_top_in, CLOSE_IN, MAP_IN)
        draw_bev(close_axes, view, ranking, close, scale_m=5.0)
        close_axes.set_xlabel("close-up: y (m)", fontsize=10.5)
        frame_close_up(map_axes, close)
        side_in += CLOSE_IN + 0.42
    side_width_in = WIDTH_IN - EDGE_IN - side_in
    top_in = map_top_in
    if ranking is not None:
        bars_in = 0.29 * len(ranking.probabilities) + 0.1
        draw_ranks(page.axes(side_in, top_in + 0.46, side_width_in, bars_in), ranking)
        top_in += bars_in + 0.52
        sentence = describe_driven(ranking)
        if sentence is not None:
            lines = wrap(sentence, side_width_in, 10.0)
            text = "\n".join(lines)
            page.text(side_in, top_in, text, fontsize=10, color=palette.INK, linespacing=1.4)
            top_in += 0.2 * len(lines) + 0.12
    if view.lidar_points_ego is not None:
        depth_width_in = min(side_width_in - 0.1, 3.5)
        _draw_depth_bar(page.axes(side_in, top_in + 0.02, depth_width_in, 0.14))
    _draw_legend(page.figure, view, ranking, whole)
    return page.figure


def _draw_cost_bar(axes: Axes, cost_image: AxesImage) -> None:
    """Colour bar of the cost map, its ends in words."""
    bar = axes.figure.colorbar(cost_image, cax=axes)
    bar.ax.tick_params(labelsize=10, length=3)
    bar.outline.set_linewidth(0.6)
    axes.set_title("high\ncost", fontsize=10.5, pad=6)
    axes.set_xlabel("low\ncost", fontsize=10.5, labelpad=6)


def _draw_depth_bar(axes: Axes) -> None:
    """Colour bar of the lidar points in the images."""
    depth = ScalarMappable(LogNorm(*LIDAR_DEPTH_M), palette.DEPTH)
    bar = axes.figure.colorbar(depth, cax=axes, orientation="horizontal")
    ticks_m = [3, 5, 10, 20, 40, 60]
    bar.set_ticks(ticks_m, labels=[str(tick) for tick in ticks_m])
    bar.ax.minorticks_off()
    bar.ax.tick_params(labelsize=10, length=3)
    bar.outline.set_linewidth(0.6)
    bar.set_label("lidar points in the images: depth (m)", fontsize=10.5)


def _draw_legend(figure: Figure, view: SampleView, ranking: Ranking | None, whole: Extent) -> None:
    """One line below everything: what each kind of mark means."""
    handles: list[Line2D | Patch] = []
    if ranking is not None:
        handles.append(
            Line2D(
                [],
                [],
                color=palette.PROBABILITY(1.0),
                linewidth=3.0,
                marker="o",
                markersize=6,
                markeredgecolor=palette.PAPER,
                label="planned (darker: more probable)",
            )
        )
    if view.driven is not None:
        style = driven_style(2.4)
        style.pop("path_effects")
        handles.append(
            Line2D(
                [],
                [],
                marker="D",
                markersize=4.5,
                markeredgecolor=palette.PAPER,
                label=f"driven, {len(view.driven) * view.dt_s:g} s (a mark each second)",
                **style,
            )
        )
    handles.append(Patch(facecolor=palette.EGO, label="ego vehicle"))
    grid = view.grid
    if whole != Extent(grid.x_min_m, grid.x_max_m, grid.y_min_m, grid.y_max_m):
        handles.append(
            Patch(facecolor=palette.OFF_MAP, edgecolor=palette.SOFT_INK, label="off the map")
        )
    figure.legend(
        handles=handles,
        loc="lower center",
        ncols=len(handles),
        frameon=False,
        fontsize=11,
        handlelength=3.0,
        columnspacing=2.2,
        borderaxespad=0.2,
    )
