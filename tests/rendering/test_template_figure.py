"""All templates at a glance."""

from pathlib import Path

import matplotlib.image as mpl_image
import numpy as np
import pytest
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from rendering_case import (
    REFUSED,
    map_axes,
    straight,
)

from shoot.rendering import render_templates, save_figure
from shoot.rendering.bev_panel import draw_driven


def test_all_templates_are_drawn_frequent_ones_on_top() -> None:
    templates = np.stack([straight(5.0, 0.8), straight(0.0), straight(10.0, -0.1)])
    figure = render_templates(templates, np.array([5, 900, 40]))
    axes = map_axes(figure)
    (drawn,) = [c for c in axes.collections if isinstance(c, LineCollection)]
    ends = np.array([segment[-1] for segment in drawn.get_segments()])
    np.testing.assert_allclose(ends, templates[[0, 2, 1], -1][:, ::-1])
    left_px, top_px = axes.transData.transform(ends[0])
    ego_px = axes.transData.transform((0.0, 0.0))
    assert left_px < ego_px[0]
    assert top_px > ego_px[1]
    assert axes.get_aspect() == 1.0
    low, high = axes.get_ylim()
    assert low < 0.0
    assert high > 50.0
    assert "3 templates of 5 s, from 945 futures" in figure.texts[0].get_text()


def test_nothing_is_said_of_futures_that_nobody_counted() -> None:
    templates = np.stack([straight(5.0), straight(8.0)])
    figure = render_templates(templates, np.zeros(2, int), dt_s=0.5)
    assert figure.texts[0].get_text() == "2 templates of 10 s"
    assert not any("trajectories" in axes.get_ylabel() for axes in figure.axes)
    named = [name for axes in figure.axes for name in axes.get_legend_handles_labels()[1]]
    assert named == ["templates"]


@pytest.mark.parametrize("dt_s", [0.1, 0.25, 0.3, 0.5])
def test_marks_are_at_whole_seconds_whatever_the_step(dt_s: float) -> None:
    way_m = 6.0 * dt_s * np.arange(1, round(3.0 / dt_s) + 1)
    axes = Figure().add_subplot()
    draw_driven(axes, np.stack([way_m, 0.5 * way_m], axis=-1), dt_s)
    (marks,) = [line for line in axes.lines if line.get_gid() == "driven-seconds"]
    np.testing.assert_allclose(marks.get_ydata(), [6.0, 12.0, 18.0], atol=1e-5)
    np.testing.assert_allclose(marks.get_xdata(), [3.0, 6.0, 9.0], atol=1e-5)


def test_templates_without_counts_are_refused() -> None:
    with pytest.raises(REFUSED, match="count"):
        render_templates(np.zeros((3, 20, 2)), np.ones(2, int))
    with pytest.raises(ValueError, match="one count each"):
        render_templates(np.zeros((0, 20, 2)), np.ones(0, int))


@pytest.mark.parametrize("k", [1, 12])
def test_few_templates_of_equal_counts_are_drawn(k: int, tmp_path: Path) -> None:
    templates = np.zeros((k, 20, 2))
    path = save_figure(render_templates(templates, np.ones(k, int)), tmp_path / "t.png", dpi=40.0)
    assert mpl_image.imread(path).std() > 0.02
