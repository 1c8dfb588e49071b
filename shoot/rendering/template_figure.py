"""All templates at a glance.

Paper: figure 5 (the 1000 templates K-Means finds in nuScenes' training set).
"""

from typing import Any

import numpy as np
from jaxtyping import Float, Int
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from shoot.rendering import palette
from shoot.rendering.bev_panel import draw_ego
from shoot.rendering.sample_view import FloatArray, from_origin

IntArray = np.ndarray[Any, np.dtype[np.integer[Any]]]


def render_templates(
    templates: Float[FloatArray, "K T 2"],
    counts: Int[IntArray, " K"],
    dt_s: float = 0.25,
    title: str = "",
) -> Figure:
    """Picture of all templates from above, and of how fast they are.

    Args:
        templates: Waypoints (x, y) in `ego`, in metres; drawn with x up and y to the left.
        counts: Trajectories behind each template; colours the lines, the most frequent on top.
            Where none were counted, nothing is said of them.
        dt_s: Time between waypoints.
        title: Headline.

    Raises:
        ValueError: If there are no templates, not finite ones, or not one count for each.
    """
    if templates.ndim != 3 or templates.shape[2] != 2 or not np.isfinite(templates).all():
        raise ValueError(f"Templates must be finite and [K, T, 2], got {list(templates.shape)}.")
    if not dt_s > 0.0:
        raise ValueError(f"dt_s must be more than 0 s, got {dt_s}.")
    if len(templates) == 0 or len(templates) != len(counts):
        raise ValueError(
            f"Templates need one count each, got {len(templates)} and {len(counts)} of them."
        )
    figure = Figure(figsize=(10.0, 6.4), facecolor=palette.PAPER)
    map_axes = figure.add_axes((0.075, 0.09, 0.47, 0.82))
    lines = _draw_templates(map_axes, templates, counts)
    counted = ""
    if counts.any():
        _draw_bar(figure, lines)
        counted = f", from {counts.sum():,} futures"
    _draw_speeds(figure.add_axes((0.725, 0.56, 0.255, 0.35)), templates, counts, dt_s)
    if counts.any():
        _draw_shares(figure.add_axes((0.725, 0.09, 0.255, 0.33)), counts)
    horizon_s = templates.shape[1] * dt_s
    figure.text(
        0.015,
        0.985,
        title or f"{len(templates):,} templates of {horizon_s:g} s{counted}",
        va="top",
        fontsize=14,
        fontweight="bold",
        color=palette.INK,
    )
    return figure


def _draw_templates(
    axes: Axes,
    templates: Float[FloatArray, "K T 2"],
    counts: Int[IntArray, " K"],
) -> LineCollection:
    """All templates from above, rare ones below frequent ones."""
    order = np.argsort(counts, kind="stable")
    paths = [from_origin(templates[k])[:, ::-1] for k in order]
    shown = np.maximum(counts[order], 1)
    # A few templates, standing above all, hold so much that they would take up the whole ramp.
    low, high = (float(value) for value in np.percentile(shown, [1.0, 99.0]))
    norm = LogNorm(low, max(high, 2.0 * low))
    lines = LineCollection(
        paths,
        array=shown.astype(np.float64),
        cmap=palette.COUNT,
        norm=norm,
        linewidths=0.8,
        alpha=0.75,
        capstyle="round",
        zorder=2,
        gid="templates",
    )
    axes.add_collection(lines)
    axes.scatter(
        templates[order, -1, 1],
        templates[order, -1, 0],
        c=shown,
        cmap=palette.COUNT,
        norm=norm,
        s=5.0,
        linewidths=0,
        zorder=3,
    )
    draw_ego(axes)
    corners = templates.reshape(-1, 2)
    rear_m = min(float(corners[:, 0].min()), -1.0) - 3.0
    forward_m = max(float(corners[:, 0].max()), 5.0) + 3.0
    half_m = max(float(np.abs(corners[:, 1]).max()) + 3.0, 0.45 * (forward_m - rear_m))
    axes.set_xlim(half_m, -half_m)  # y points left, so it grows to the left
    axes.set_ylim(rear_m, max(forward_m, rear_m + 2.0 * half_m / 0.9))
    axes.set_aspect("equal", anchor="SW")
    axes.set_xlabel("y: left (m)", fontsize=11)
    axes.set_ylabel("x: forward (m)", fontsize=11)
    axes.tick_params(labelsize=10)
    axes.grid(color="#e4e7ea", linewidth=0.6, zorder=0)
    axes.set_axisbelow(True)
    return lines


def _draw_bar(figure: Figure, lines: LineCollection) -> None:
    """What the colours of the templates mean."""
    axes = figure.add_axes((0.555, 0.09, 0.016, 0.82))
    bar = figure.colorbar(ScalarMappable(lines.norm, lines.get_cmap()), cax=axes, extend="both")
    bar.set_label("trajectories per template", fontsize=11)
    axes.yaxis.set_major_formatter("{x:g}")
    axes.tick_params(labelsize=10)


def _draw_speeds(
    axes: Axes,
    templates: Float[FloatArray, "K T 2"],
    counts: Int[IntArray, " K"],
    dt_s: float,
) -> None:
    """Mean speeds of the templates, beside those of the trajectories they stand for."""
    steps_m = np.diff(np.concatenate([np.zeros_like(templates[:, :1]), templates], axis=1), axis=1)
    speeds_mps = np.linalg.norm(steps_m, axis=-1).sum(axis=1) / (templates.shape[1] * dt_s)
    edges = np.arange(0.0, np.ceil(float(speeds_mps.max())) + 1.5, 1.0)
    if counts.any():
        axes.hist(
            speeds_mps,
            bins=edges.tolist(),
            weights=100.0 * counts / int(counts.sum()),
            color=palette.DRIVEN,
            alpha=0.45,
            label="trajectories",
        )
    axes.hist(
        speeds_mps,
        bins=edges.tolist(),
        weights=np.full(len(templates), 100.0 / len(templates)),
        histtype="step",
        color=palette.PLANNED,
        linewidth=2.0,
        label="templates",
    )
    axes.set_xlabel("mean speed (m/s)", fontsize=11)
    axes.set_ylabel("share (%)", fontsize=11)
    axes.legend(frameon=False, fontsize=10, loc="lower right", bbox_to_anchor=(1.02, 0.98), ncols=2)
    _strip(axes)


def _draw_shares(axes: Axes, counts: Int[IntArray, " K"]) -> None:
    """What share of the driving the most frequent templates cover: the reach of guessing."""
    covered = 100.0 * np.cumsum(np.sort(counts)[::-1]) / max(int(counts.sum()), 1)
    axes.plot(np.arange(1, len(counts) + 1), covered, color=palette.DRIVEN, linewidth=2.0)
    if len(counts) >= 10:
        axes.plot(10, covered[9], marker="o", color=palette.PLANNED, markersize=6)
        axes.annotate(
            f"ten: {covered[9]:.0f} %",
            (10, covered[9]),
            xytext=(8, -4),
            textcoords="offset points",
            va="top",
            fontsize=10,
        )
    axes.set_xscale("log")
    axes.set_ylim(0.0, 103.0)
    axes.set_xlabel("most frequent templates", fontsize=11)
    axes.set_ylabel("trajectories covered (%)", fontsize=11)
    _strip(axes)


def _strip(axes: Axes) -> None:
    """Less frame, more data."""
    axes.tick_params(labelsize=10)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
