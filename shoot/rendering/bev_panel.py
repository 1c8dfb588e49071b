"""The ground from above, forward up: cost map, ranked trajectories, the driven one, the ego."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.image import AxesImage
from matplotlib.patches import FancyBboxPatch, Rectangle
from matplotlib.patheffects import Normal, Stroke

from lss_core.grid import BevGrid
from shoot.footprint import EGO_LENGTH_M, EGO_REAR_M, EGO_WIDTH_M
from shoot.rendering import palette
from shoot.rendering.line_style import driven_style
from shoot.rendering.sample_view import FloatArray, Ranking, SampleView, from_origin
from shoot.trajectories.poses import positions_at


def cost_range(cost_map: Float[FloatArray, "X Y"]) -> tuple[float, float]:
    """Costs shown as the two ends of the ramp: the 2nd and the 98th percentile.

    So outliers do not wash out the rest. The range is never empty, even for a flat map.
    """
    finite = cost_map[np.isfinite(cost_map)]
    if finite.size == 0:
        return 0.0, 1.0
    low, high = (float(value) for value in np.percentile(finite, [2.0, 98.0]))
    if high - low < 1e-6:
        low, high = low - 0.5, low + 0.5
    return low, high


@dataclass(frozen=True)
class Extent:
    """A rectangle of the ground in metres, in `ego`."""

    x_min_m: float
    x_max_m: float
    y_min_m: float
    y_max_m: float


def whole_extent(grid: BevGrid, paths_m: list[Float[FloatArray, "_ 2"]]) -> Extent:
    """The grid, grown by 3 m and more where a path leaves it."""
    low = np.array([grid.x_min_m, grid.y_min_m])
    high = np.array([grid.x_max_m, grid.y_max_m])
    for path_m in paths_m:
        low = np.minimum(low, np.where(path_m.min(axis=0) < low, path_m.min(axis=0) - 3.0, low))
        high = np.maximum(high, np.where(path_m.max(axis=0) > high, path_m.max(axis=0) + 3.0, high))
    return Extent(float(low[0]), float(high[0]), float(low[1]), float(high[1]))


def close_extent(paths_m: list[Float[FloatArray, "_ 2"]], width_per_height: float) -> Extent:
    """The smallest rectangle of these proportions round the car and all paths, 2.5 m to spare."""
    car = np.array([[-EGO_REAR_M, 0.0], [EGO_LENGTH_M - EGO_REAR_M, 0.0]])
    corners = np.concatenate([car, *paths_m])
    low, high = corners.min(axis=0) - 2.5, corners.max(axis=0) + 2.5
    forward_m = max(float(high[0] - low[0]), float(high[1] - low[1]) / width_per_height, 15.0)
    middle = 0.5 * (low + high)
    half_width_m = 0.5 * forward_m * width_per_height
    return Extent(
        float(low[0]),
        float(low[0]) + forward_m,
        float(middle[1]) - half_width_m,
        float(middle[1]) + half_width_m,
    )


def all_paths(view: SampleView, ranking: Ranking | None) -> list[Float[FloatArray, "_ 2"]]:
    """The paths to be drawn: planned ones and the driven one, each from the ego's origin."""
    paths_m: list[FloatArray] = [] if ranking is None else list(ranking.paths_m)
    if view.driven is not None:
        paths_m.append(from_origin(view.driven))
    return paths_m


def draw_bev(
    axes: Axes, view: SampleView, ranking: Ranking | None, extent: Extent, scale_m: float = 10.0
) -> AxesImage | None:
    """Fill the panel; returns the cost map's image for its colour bar."""
    axes.set_facecolor(palette.OFF_MAP)
    axes.tick_params(labelsize=10, length=3)
    grid = view.grid
    borders_m = (grid.y_min_m, grid.y_max_m, grid.x_min_m, grid.x_max_m)
    cost_image = None
    if view.cost_map is not None:
        low, high = cost_range(view.cost_map)
        cost_image = axes.imshow(
            view.cost_map,
            origin="lower",
            extent=borders_m,
            cmap=palette.COST,
            vmin=low,
            vmax=high,
            interpolation="nearest",
            zorder=0,
        )
    else:
        axes.add_patch(
            Rectangle(
                (grid.y_min_m, grid.x_min_m),
                grid.y_max_m - grid.y_min_m,
                grid.x_max_m - grid.x_min_m,
                facecolor=palette.PAPER,
                linewidth=0,
                zorder=0,
            )
        )
    axes.set_aspect("equal")
    axes.set_xlim(extent.y_max_m, extent.y_min_m)  # y points left, so it grows to the left
    axes.set_ylim(extent.x_min_m, extent.x_max_m)
    if view.lidar_points_ego is not None:
        axes.scatter(
            view.lidar_points_ego[:, 1],
            view.lidar_points_ego[:, 0],
            s=0.6,
            color=palette.SOFT_INK,
            linewidths=0,
            zorder=1,
            gid="lidar",
        )
    draw_ego(axes)
    if ranking is not None:
        draw_ranked(axes, ranking)
    if view.driven is not None:
        draw_driven(axes, view.driven, view.dt_s)
    draw_scale_bar(axes, extent, scale_m)
    return cost_image


def frame_close_up(axes: Axes, extent: Extent) -> None:
    """Outline on the whole map of what the close-up shows."""
    axes.add_patch(
        Rectangle(
            (extent.y_min_m, extent.x_min_m),
            extent.y_max_m - extent.y_min_m,
            extent.x_max_m - extent.x_min_m,
            fill=False,
            edgecolor=palette.INK,
            linewidth=0.8,
            linestyle=(0, (1, 2)),
            zorder=3,
        )
    )


def draw_ranked(axes: Axes, ranking: Ranking) -> None:
    """The ranked trajectories, the best on top; dots end them, since many differ in speed only."""
    for place in reversed(range(len(ranking.paths_m))):
        strength = float(ranking.strengths[place])
        path_m = ranking.paths_m[place]
        style: dict[str, Any] = {"color": palette.PROBABILITY(strength), "zorder": 4 + strength}
        axes.plot(
            path_m[:, 1],
            path_m[:, 0],
            linewidth=1.2 + 1.8 * strength,
            solid_capstyle="round",
            gid="planned",
            **style,
        )
        axes.plot(
            path_m[-1, 1],
            path_m[-1, 0],
            marker="o",
            markersize=4.0 + 2.0 * strength,
            markeredgecolor=palette.PAPER,
            markeredgewidth=0.7,
            gid="planned-end",
            **style,
        )


def draw_driven(axes: Axes, driven: Float[FloatArray, "T 2"], dt_s: float) -> None:
    """The driven path, dashed, with a tick at every full second: speed is seen as spacing."""
    path_m = from_origin(driven)
    axes.plot(path_m[:, 1], path_m[:, 0], zorder=6, gid="driven", **driven_style(2.2))
    times_s = dt_s * np.arange(len(path_m))
    seconds_m = positions_at(times_s, path_m, np.arange(1.0, times_s[-1] + 1e-9))
    axes.plot(
        seconds_m[:, 1],
        seconds_m[:, 0],
        linestyle="none",
        marker="D",
        markersize=4.2,
        color=palette.DRIVEN,
        markeredgecolor=palette.PAPER,
        markeredgewidth=0.8,
        zorder=7,
        gid="driven-seconds",
    )


def draw_ego(axes: Axes) -> None:
    """The car's outline; its nose is marked."""
    axes.add_patch(
        FancyBboxPatch(
            (-EGO_WIDTH_M / 2, -EGO_REAR_M),
            EGO_WIDTH_M,
            EGO_LENGTH_M,
            boxstyle="round,pad=0,rounding_size=0.5",
            facecolor=palette.EGO,
            edgecolor=palette.PAPER,
            linewidth=0.8,
            zorder=3,
            gid="ego",
        )
    )


def draw_scale_bar(axes: Axes, extent: Extent, length_m: float) -> None:
    """A known length in the lower corner that is farther from the car."""
    height_m = extent.x_max_m - extent.x_min_m
    if extent.y_max_m > -extent.y_min_m:
        left_m = extent.y_max_m - 0.04 * height_m
    else:
        left_m = extent.y_min_m + 0.04 * height_m + length_m
    axes.plot(
        [left_m, left_m - length_m],
        [extent.x_min_m + 0.035 * height_m] * 2,
        color=palette.INK,
        linewidth=2.5,
        solid_capstyle="butt",
        path_effects=[Stroke(linewidth=5.0, foreground="#ffffffd0"), Normal()],
        zorder=8,
        gid="scale",
    )
    axes.text(
        left_m - 0.5 * length_m,
        extent.x_min_m + 0.048 * height_m,
        f"{length_m:g} m",
        ha="center",
        va="bottom",
        fontsize=10,
        color=palette.INK,
        path_effects=[Stroke(linewidth=3.5, foreground="#ffffffd0"), Normal()],
        zorder=8,
    )
