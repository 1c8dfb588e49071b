"""Time and memory against size, each curve beside the straight line it must not rise above."""

from collections.abc import Sequence
from pathlib import Path

import matplotlib.pyplot as plt

from benchmarks.growth import Growth
from shoot.rendering import save_figure


def draw_growth(growths: Sequence[Growth], path: Path) -> None:
    """One panel each, both axes logarithmic, and save it."""
    figure, axes = plt.subplots(1, len(growths), figsize=(3.0 * len(growths), 3.2))
    for axis, growth in zip(axes, growths, strict=True):
        sizes = growth.sizes
        for values, label, colour, exponent in (
            (growth.seconds, "time, s", "#0072B2", growth.exponent),
            ([mb / 1000 for mb in growth.mb], "memory, GB", "#D55E00", growth.memory_exponent),
        ):
            text = f"{label}: exponent {exponent:.2f}"
            axis.plot(sizes, values, "o-", color=colour, label=text, markersize=4)
            linear = [values[-1] * size / sizes[-1] for size in sizes]
            axis.plot(sizes, linear, ":", color=colour, linewidth=1)
        axis.set(xscale="log", yscale="log", xlabel=growth.of, title=growth.what)
        axis.title.set_fontsize(9)
        axis.set_xticks(sizes, [f"{size:,.0f}" for size in sizes], rotation=45, fontsize=7)
        axis.minorticks_off()
        axis.grid(alpha=0.3)
        axis.legend(fontsize=7, frameon=False)
    figure.tight_layout()
    save_figure(figure, path)
