"""Figure 7 as a picture of the rig: what the loss of each camera costs, where it looks."""

import math
from collections.abc import Sequence
from pathlib import Path

import matplotlib.pyplot as plt
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.patches import Wedge
from run_queue import Record

from robustness_table.conditions import PLAIN, UNDISTURBED
from robustness_table.curves_figure import SHOWN
from shoot.rendering import palette, save_figure
from shoot.rendering.bev_panel import draw_ego
from shoot.world.sensing.rig_plans import NUSCENES, CameraPlan

_REACH_M = 12.0
_LABEL_M = 8.0


def draw_rig(records: Sequence[Record], path: Path) -> bool:
    """A panel for each task: a wedge for each camera, the darker the more its loss costs.

    Args:
        records: One for each run and condition.
        path: Of the picture.

    Returns:
        Whether there was something to draw.
    """
    found = {(r["task"], r["condition"]): r["scores"] for r in records if r["run"] == PLAIN}
    tasks = [
        task
        for task in SHOWN
        if all((task, name) in found for name in (UNDISTURBED, *map(_without, NUSCENES.cameras)))
    ]
    if not tasks:
        return False
    figure, panels = plt.subplots(1, len(tasks), figsize=(5.4 * len(tasks), 5.4), squeeze=False)
    for axes, task in zip(panels[0], tasks, strict=True):
        metric, label = SHOWN[task]
        full = found[task, UNDISTURBED][metric]["value"]
        lost = [full - found[task, _without(c)][metric]["value"] for c in NUSCENES.cameras]
        axes.set_title(f"{task}: {label}, {full:.1f} with all", fontsize=11, pad=2)
        _draw_wedges(axes, lost)
    figure.tight_layout()
    save_figure(figure, path)
    plt.close(figure)
    return True


def _without(camera: CameraPlan) -> str:
    return f"without-{camera.channel}"


def _draw_wedges(axes: Axes, lost: Sequence[float]) -> None:
    """Forward is up, left is left: y points left, so it grows to the left."""
    colours = ScalarMappable(Normalize(0.0, max(*lost, 1e-6)), palette.PROBABILITY)
    for camera, points in zip(NUSCENES.cameras, lost, strict=True):
        half_deg = math.degrees(math.atan(0.5 * NUSCENES.width_px / camera.focal_px))
        place = (camera.position_m[1], camera.position_m[0])
        middle_deg = 90.0 - math.degrees(camera.yaw_rad)
        axes.add_patch(
            Wedge(
                place, _REACH_M, middle_deg - half_deg, middle_deg + half_deg,
                facecolor=colours.to_rgba(points), edgecolor=palette.PAPER, alpha=0.6,
            )
        )  # fmt: skip
        at = math.radians(middle_deg)
        axes.text(
            place[0] + _LABEL_M * math.cos(at),
            place[1] + _LABEL_M * math.sin(at),
            f"{camera.channel.removeprefix('CAM_').replace('_', ' ').lower()}\n{-points:+.1f}",
            ha="center",
            va="center",
            fontsize=9,
        )
    axes.set_aspect("equal")
    axes.set(xlim=(14.5, -14.5), ylim=(-13.0, 14.5))
    axes.axis("off")
    draw_ego(axes)
