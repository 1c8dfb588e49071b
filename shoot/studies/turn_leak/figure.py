"""Picture of whether a planner knows the ego's way, by distance to the intersection."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from shoot.rendering import palette
from shoot.studies.turn_leak.report import REACH_M, LeakReport

# Bins with fewer approaches are left out: their points would only be noise.
LEAST_APPROACHES = 4


def render_leak(leak: LeakReport) -> Figure:
    """Picture of how often the way taken is named, by distance to the intersection.

    Args:
        leak: Of one planner.
    """
    figure = Figure(figsize=(10.5, 4.6), facecolor=palette.PAPER)
    all_axes = figure.subplots(1, 2, sharey=True)
    figure.subplots_adjust(left=0.075, right=0.985, bottom=0.215, top=0.80, wspace=0.06)
    roads = ("one lane a side", "several lanes a side")
    for axes, road in zip(all_axes, roads, strict=True):
        _draw_road(axes, leak, road)
    all_axes[0].set_ylabel("names the way taken (%)", fontsize=11)
    named = {str(line.get_label()): line for axes in all_axes for line in axes.lines}
    figure.legend(
        list(named.values()), list(named), loc="upper right", bbox_to_anchor=(0.99, 1.0),
        ncols=3, frameon=False, fontsize=10,
    )  # fmt: skip
    figure.text(
        0.012, 0.975, f"Does the planner know the ego's way?  ({leak.split})",
        va="top", fontsize=13, fontweight="bold", color=palette.INK,
    )  # fmt: skip
    figure.text(
        0.012, 0.02,
        f"Bands: 95 % over scenes. Small numbers: approaches ({LEAST_APPROACHES} at least). "
        "Nothing in the images may tell the way before the ego brakes or waits for it.",
        fontsize=9, color=palette.SOFT_INK,
    )  # fmt: skip
    return figure


def _draw_road(axes: Axes, leak: LeakReport, road: str) -> None:
    styles = (
        ("before braking", palette.DRIVEN, "-", "o", 97.0),
        ("braking or waiting", palette.PLANNED, "--", "s", 92.5),
    )
    for stage, colour, line, marker, text_y in styles:
        bins = [
            row
            for row in leak.by_distance
            if row[0] == road and row[1] == stage and row[4].count >= LEAST_APPROACHES
        ]
        if not bins:
            continue
        middle_m = [(low + high) / 2 for _, _, low, high, _ in bins]
        scores = [score for *_, score in bins]
        # One scene alone has no interval.
        low = [s.value if np.isnan(s.low) else s.low for s in scores]
        high = [s.value if np.isnan(s.high) else s.high for s in scores]
        axes.fill_between(middle_m, low, high, color=colour, alpha=0.18, linewidth=0)
        axes.plot(
            middle_m, [s.value for s in scores], line, color=colour, marker=marker, label=stage
        )
        for x, score in zip(middle_m, scores, strict=True):
            axes.text(x, text_y, str(score.count), color=colour, fontsize=8.5, ha="center")
        if stage == "before braking":
            axes.plot(
                middle_m, [s.chance for s in scores], ":", color=palette.INK, linewidth=1.6,
                label="chance",
            )  # fmt: skip
    if not axes.lines:
        axes.text(0.5, 0.5, "too few approaches", transform=axes.transAxes, ha="center")
    axes.set_title(road, fontsize=11, loc="left", color=palette.INK)
    axes.set_xlim(REACH_M, 0.0)
    axes.set_ylim(0.0, 102.0)
    axes.set_xlabel("distance to the intersection (m)", fontsize=11)
    axes.tick_params(labelsize=10)
    axes.grid(color="#e4e7ea", linewidth=0.6)
    axes.set_axisbelow(True)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
