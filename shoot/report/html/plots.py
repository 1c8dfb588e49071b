"""Plots of the page, as matplotlib figures no wider than a telephone."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import cycle
from typing import Any, Final

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from lss_core.legible import legible
from shoot.evaluation.results import MODEL, Results
from shoot.metrics.bootstrap import Interval
from shoot.metrics.calibration import Reliability
from shoot.metrics.ranks import TOP_KS
from shoot.rendering import palette
from shoot.report.html.columns import Column
from shoot.report.html.words import has_bounds

WIDTH_IN: Final = 4.4
SQUARE_IN: Final = 3.0
_FONT_PT: Final = 9.0
_GRID: Final = "#e4e7ea"
# Two numbers without a common divisor: 56 methods before a colour comes with the same marker again.
_COLOURS: Final = (
    palette.DRIVEN, palette.INK, "#009e73", palette.SOFT_INK, "#cc79a7", "#56b4e9", "#e69f00",
)  # fmt: skip
_MARKERS: Final = ("s", "D", "^", "v", "P", "X", "<", ">")


@dataclass(frozen=True)
class Look:
    """How a method is drawn, the same in every plot."""

    colour: str
    marker: str


def method_looks(names: Sequence[str]) -> dict[str, Look]:
    """The model in the colour of what is planned, the others in order of appearance."""
    others = [name for name in names if name != MODEL]
    looks = {
        name: Look(colour, marker)
        for name, colour, marker in zip(others, cycle(_COLOURS), cycle(_MARKERS), strict=False)
    }
    return {name: looks.get(name, Look(palette.PLANNED, "o")) for name in names}


def draw_key(look: Look) -> Figure:
    """A method's mark alone, for the list of methods beside the plots."""
    figure, axes = _new(0.34, 0.16)
    axes.set_position((0.0, 0.0, 1.0, 1.0))
    axes.set_axis_off()
    axes.plot([0.0, 1.0], [0.0, 0.0], color=look.colour, linewidth=1.6)
    axes.plot(
        [0.5], [0.0], look.marker, color=look.colour, markersize=6, markeredgecolor=palette.PAPER
    )
    axes.set_xlim(0.0, 1.0)
    axes.set_ylim(-1.0, 1.0)
    return figure


def draw_parts(parts: Mapping[str, Results], column: Column, looks: Mapping[str, Look]) -> Figure:
    """One metric of each method in each part, as dots with their intervals."""
    step = 0.62 / max(len(looks) - 1, 1)
    height_in = 0.55 + len(parts) * (0.3 + 0.14 * len(looks))
    figure, axes = _new(WIDTH_IN, height_in)
    for row, results in enumerate(parts.values()):
        if row % 2:
            axes.axhspan(row - 0.5, row + 0.5, color="#f6f7f8", linewidth=0, zorder=0)
        for idx, (name, look) in enumerate(looks.items()):
            interval = results.methods.get(name, {}).get(column.key)
            if interval is None or not math.isfinite(interval.value):
                continue
            y = row + (idx - (len(looks) - 1) / 2.0) * step
            if has_bounds(interval):
                axes.plot([interval.low, interval.high], [y, y], color=look.colour, linewidth=1.4)
            _dots(axes, [interval.value], [y], look)
    axes.set_ylim(len(parts) - 0.5, -0.5)
    axes.set_yticks(range(len(parts)), [_short(name) for name in parts])
    axes.tick_params(axis="y", length=0)
    axes.set_xlabel(column.name)
    axes.grid(axis="y", visible=False)
    figure.subplots_adjust(
        left=0.26, right=0.97, top=1.0 - 0.06 / height_in, bottom=0.46 / height_in
    )
    return figure


def draw_top_k(methods: Mapping[str, Mapping[str, Interval]], looks: Mapping[str, Look]) -> Figure:
    """Top-k accuracy against k, with intervals."""
    figure, axes = _new(WIDTH_IN, 3.2)
    for idx, (name, look) in enumerate(looks.items()):
        points = [
            (k + 0.16 * (idx - (len(looks) - 1) / 2.0), methods[name][f"top{k}"])
            for k in TOP_KS
            if f"top{k}" in methods[name]
        ]
        x = [at for at, _ in points]
        axes.plot(x, [p.value for _, p in points], color=look.colour, linewidth=1.4, zorder=2)
        for at, point in points:
            if has_bounds(point):
                axes.plot([at, at], [point.low, point.high], color=look.colour, linewidth=1.0)
        _dots(axes, x, [p.value for _, p in points], look)
    axes.set_xticks(TOP_KS)
    axes.set_xlabel("k: templates that may be named")
    axes.set_ylabel("label among them, %")
    axes.set_ylim(bottom=0.0)
    figure.subplots_adjust(left=0.13, right=0.97, top=0.97, bottom=0.15)
    return figure


def draw_reliability(bins: Reliability, look: Look, limit: float) -> Figure:
    """How often the most probable template is the label, against its probability.

    Args:
        bins: Of one method.
        look: Of the same.
        limit: End of both axes, between 0 and 1; the same for methods to be compared.
    """
    figure, axes = _new(SQUARE_IN, SQUARE_IN)
    end = 100.0 * limit
    axes.plot([0.0, end], [0.0, end], color=palette.SOFT_INK, linewidth=1.0, linestyle="--")
    confidence, accuracy = 100.0 * bins.confidence, 100.0 * bins.accuracy
    axes.plot(confidence, accuracy, color=look.colour, linewidth=1.4)
    _dots(axes, confidence, accuracy, look)
    axes.set_xlim(0.0, end)
    axes.set_ylim(0.0, end)
    axes.set_aspect("equal")
    axes.set_xlabel("probability given, %")
    axes.set_ylabel("how often it is the label, %")
    figure.subplots_adjust(left=0.17, right=0.96, top=0.97, bottom=0.16)
    return figure


def reliability_limit(reliability: Mapping[str, Reliability]) -> float:
    """End of the axes that holds every point of every method; above 0, at most about 1."""
    values = [
        np.ravel(v) for bins in reliability.values() for v in (bins.confidence, bins.accuracy)
    ]
    every = np.concatenate([np.zeros(1), *values])
    return max(1.06 * float(every[np.isfinite(every)].max()), 0.05)


def _new(width_in: float, height_in: float) -> tuple[Figure, Axes]:
    """A figure with one pair of axes in the page's style."""
    style = {
        "font.size": _FONT_PT,
        "axes.labelsize": _FONT_PT,
        "xtick.labelsize": _FONT_PT,
        "ytick.labelsize": _FONT_PT,
        "axes.edgecolor": palette.SOFT_INK,
        "axes.labelcolor": palette.INK,
        "xtick.color": palette.INK,
        "ytick.color": palette.INK,
        "axes.grid": True,
        "axes.axisbelow": True,
        "grid.color": _GRID,
        "grid.linewidth": 0.7,
        "axes.spines.top": False,
        "axes.spines.right": False,
    }
    with mpl.rc_context(style):
        figure = Figure(figsize=(width_in, height_in), facecolor=palette.PAPER)
        return figure, figure.add_subplot()


def _dots(axes: Axes, x: Any, y: Any, look: Look) -> None:
    axes.plot(
        x, y, look.marker, color=look.colour, markersize=6, markeredgecolor=palette.PAPER,
        markeredgewidth=0.7, linestyle="none", zorder=3,
    )  # fmt: skip


def _short(name: str) -> str:
    """A part's name that fits beside the axes; dollars would start a formula."""
    text = " ".join(legible(name).split())
    text = text if len(text) <= 16 else text[:15] + "…"
    return text.replace("$", r"\$")
