"""Figure 6: how good each run is, the more its cameras are disturbed when it is asked."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
from matplotlib.axes import Axes
from run_queue import Record

from robustness_table.conditions import DROPS, NOISE_RAD, UNDISTURBED, curves_of
from shoot.rendering import save_figure

# What a panel shows of each task, higher is better.
SHOWN = {"segmentation": ("car", "IoU of cars, %"), "planning": ("top10", "top-10, %")}
_COLOURS = ("#1b1f24", "#0072b2", "#d55e00")  # Okabe-Ito
_DASHES = ("-", "--", "-.")


def draw_curves(records: Sequence[Record], path: Path) -> bool:
    """A row for each task, noise on the left, dropped cameras on the right.

    Args:
        records: One for each run and condition.
        path: Of the picture.

    Returns:
        Whether there was something to draw.
    """
    found = {(r["task"], r["run"], r["condition"]): r["scores"] for r in records}
    tasks = [task for task in SHOWN if any(record["task"] == task for record in records)]
    if not tasks:
        return False
    figure, panels = plt.subplots(
        len(tasks), 2, figsize=(9.0, 3.3 * len(tasks)), squeeze=False, sharey="row"
    )
    for row, task in zip(panels, tasks, strict=True):
        metric, label = SHOWN[task]
        noise = {UNDISTURBED: 0.0} | {f"noise-{level:g}": level for level in NOISE_RAD}
        drops = {UNDISTURBED: 0.0} | {f"drop-{num}": float(num) for num in DROPS}
        _draw_panel(row[0], found, task, curves_of(task, "noise"), noise, metric)
        _draw_panel(row[1], found, task, curves_of(task, "drop"), drops, metric)
        row[0].set(ylabel=f"{task}: {label}", xlabel="noise when asked: rotation, rad")
        row[1].set(xlabel="cameras dropped when asked, of 6")
    figure.tight_layout()
    save_figure(figure, path)
    plt.close(figure)
    return True


def _draw_panel(
    axes: Axes,
    found: Mapping[tuple[Any, Any, Any], Record],
    task: str,
    runs: Sequence[str],
    conditions: Mapping[str, float],
    metric: str,
) -> None:
    for run, colour, dashes in zip(runs, _COLOURS, _DASHES, strict=True):
        points = {
            at: found[task, run, name][metric]
            for name, at in conditions.items()
            if (task, run, name) in found
        }
        if not points:
            continue
        places = sorted(points)
        values, low, high = ([points[at][key] for at in places] for key in ("value", "low", "high"))
        axes.plot(places, values, dashes, marker="o", color=colour, markersize=4, label=run)
        axes.fill_between(places, low, high, color=colour, alpha=0.12, linewidth=0)
    axes.set_ylim(bottom=0.0)
    axes.grid(alpha=0.3)
    axes.legend(title="trained", fontsize=8, title_fontsize=8, frameon=False)
