"""The picture of a sample: paths, map, ranks and legend say the same."""

from pathlib import Path

import matplotlib.image as mpl_image
import numpy as np
import pytest
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from rendering_case import (
    PIXEL_FROM_CAMERA,
    REFUSED,
    looking,
    make_view,
    map_axes,
    straight,
)

from lss_core.config import CAMERAS
from lss_core.grid import BevGrid
from shoot.rendering import palette, render_sample, save_figure
from shoot.rendering.bev_panel import close_extent, cost_range, draw_ego, whole_extent
from shoot.rendering.layout import camera_places
from shoot.rendering.sample_view import from_origin, rank


@pytest.fixture(scope="module")
def figure() -> Figure:
    return render_sample(make_view())


def lines(figure: Figure, gid: str) -> list:
    return [line for axes in figure.axes for line in axes.lines if line.get_gid() == gid]


def camera_axes(figure: Figure, name: str):
    (axes,) = [a for a in figure.axes if any(t.get_text() == name for t in a.texts)]
    return axes


def test_paths_appear_only_in_cameras_that_see_them(figure: Figure) -> None:
    for name in ("front", "back"):
        gids = {line.get_gid() for line in camera_axes(figure, name).lines}
        assert ({"planned", "driven"} <= gids) == (name == "front")
    assert not camera_axes(figure, "back").lines


def test_drawn_driven_path_is_the_projected_one() -> None:
    figure = render_sample(make_view(driven=straight(6.0, 0.1)))
    (line,) = [x for x in camera_axes(figure, "front").lines if x.get_gid() == "driven"]
    np.testing.assert_allclose(line.get_xdata(), 70.0, atol=1e-9)
    assert np.min(line.get_ydata()) == pytest.approx(60.0 + 150.0 / 30.0)


def test_template_to_the_left_ends_on_the_left_half_and_ahead_above_the_car() -> None:
    figure = render_sample(make_view(probabilities=np.array([0.9, 0.06, 0.04])))
    axes = map_axes(figure)
    ends = [line for line in axes.lines if line.get_gid() == "planned-end"]
    best = max(ends, key=lambda line: line.get_zorder())
    x_px, y_px = axes.transData.transform(np.column_stack(best.get_data()))[0]
    ego_px = axes.transData.transform((0.0, 0.0))
    box = axes.get_window_extent()
    assert x_px < 0.5 * (box.x0 + box.x1)
    assert x_px < ego_px[0]
    assert y_px > ego_px[1]


def test_cost_cell_lies_under_the_point_it_belongs_to() -> None:
    cost_map = np.zeros((50, 50))
    cost_map[40, 30] = 1.0  # x 30..32 m, y 10..12 m: ahead, to the left
    view = make_view(cost_map=cost_map, templates=None, probabilities=None, driven=None)
    axes = map_axes(render_sample(view))
    (image,) = axes.images
    y0, y1, x0, x1 = image.get_extent()
    array = np.asarray(image.get_array())
    row, column = (int(i) for i in np.argwhere(array == 1.0)[0])
    assert image.origin == "lower"
    assert x0 + (row + 0.5) * (x1 - x0) / 50 == pytest.approx(31.0)
    assert y0 + (column + 0.5) * (y1 - y0) / 50 == pytest.approx(11.0)
    assert axes.get_xlim() == (50.0, -50.0)  # left on the left


def test_map_and_images_have_the_same_ten_best() -> None:
    rng = np.random.default_rng(0)
    templates = np.stack([straight(s) for s in rng.uniform(4.0, 9.0, 30)])
    probabilities = rng.dirichlet(np.ones(30))
    view = make_view(templates=templates, probabilities=probabilities)
    figure = render_sample(view)
    best = np.sort(templates[np.argsort(probabilities)[-10:], -1, 0])
    drawn = [line for line in map_axes(figure).lines if line.get_gid() == "planned-end"]
    np.testing.assert_allclose(np.sort([line.get_ydata()[0] for line in drawn]), best)
    in_front = [x for x in camera_axes(figure, "front").lines if x.get_gid() == "planned"]
    np.testing.assert_allclose(
        np.sort([np.min(line.get_ydata()) for line in in_front]), np.sort(60.0 + 150.0 / best)
    )


def test_legend_names_planned_and_driven_in_their_own_style(figure: Figure) -> None:
    (legend,) = figure.legends
    labels = [text.get_text() for text in legend.get_texts()]
    assert any(label.startswith("planned") for label in labels)
    assert any(label.startswith("driven, 5 s") for label in labels)
    planned, driven = legend.get_lines()[:2]
    assert planned.get_linestyle() == "-"
    assert driven.get_linestyle() == "--"
    assert to_rgb(driven.get_color()) == to_rgb(palette.DRIVEN)
    (without,) = render_sample(make_view(driven=None)).legends
    assert not any(text.get_text().startswith("driven") for text in without.get_texts())


def test_probabilities_and_driven_rank_are_written(figure: Figure) -> None:
    words = "\n".join(text.get_text() for axes in figure.axes for text in axes.texts)
    assert all(label in words for label in ("50.0 %", "30.0 %", "20.0 %"))
    below = "\n".join(text.get_text() for text in figure.texts)
    assert "rank 2," in " ".join(below.split())


def test_ranking_against_a_plain_reference() -> None:
    rng = np.random.default_rng(1)
    templates = rng.normal(0.0, 10.0, (50, 20, 2))
    probabilities = rng.dirichlet(np.ones(50))
    driven = rng.normal(0.0, 10.0, (20, 2))
    ranking = rank(make_view(templates=templates, probabilities=probabilities, driven=driven))
    assert ranking is not None
    distances = [float(((t - driven) ** 2).sum()) for t in templates]
    nearest = distances.index(min(distances))
    better = sum(p > probabilities[nearest] for p in probabilities)
    assert ranking.driven_rank == better + 1
    assert ranking.driven_probability == probabilities[nearest]
    assert ranking.driven_distance_m == pytest.approx(
        np.mean([np.hypot(*(a - b)) for a, b in zip(templates[nearest], driven, strict=True)])
    )
    assert list(ranking.probabilities) == sorted(probabilities, reverse=True)[:10]


def test_equal_probabilities_of_zero_do_not_divide_by_zero() -> None:
    ranking = rank(make_view(probabilities=np.zeros(3)))
    assert ranking is not None
    assert np.isfinite(ranking.strengths).all()


def test_path_off_the_grid_widens_the_map_and_says_so(figure: Figure) -> None:
    wide = render_sample(make_view(driven=straight(16.0)))  # ends 80 m ahead
    assert map_axes(wide).get_ylim() == (-50.0, 83.0)
    assert map_axes(wide).get_xlim() == (50.0, -50.0)
    assert "off the map" in [text.get_text() for text in wide.legends[0].get_texts()]
    assert "off the map" not in [text.get_text() for text in figure.legends[0].get_texts()]


def test_grid_of_two_unequal_sides_keeps_its_shape() -> None:
    grid = BevGrid(-10.0, 60.0, -30.0, 20.0, 1.0)
    axes = map_axes(render_sample(make_view(grid=grid, cost_map=np.zeros(grid.shape))))
    assert axes.get_xlim() == (20.0, -30.0)
    assert axes.get_ylim() == (-10.0, 60.0)
    assert axes.get_aspect() == 1.0


def test_everything_optional_may_be_absent() -> None:
    view = make_view(cost_map=None, templates=None, probabilities=None, driven=None)
    figure = render_sample(view)
    assert not lines(figure, "planned")
    assert not lines(figure, "driven")
    assert len([axes for axes in figure.axes if axes.images]) == 6


def test_lidar_points_are_coloured_where_the_camera_sees_them() -> None:
    points = np.array([[10.0, 0.0, 1.5], [-10.0, 0.0, 1.5], [10.0, 0.0, 90.0], [0.0, 0.0, 0.0]])
    figure = render_sample(make_view(lidar_points_ego=points))
    (front,) = [c for c in camera_axes(figure, "front").collections if c.get_gid() == "lidar"]
    np.testing.assert_allclose(front.get_offsets(), [[80.0, 60.0]])
    assert np.exp(front.get_array()[0]) == pytest.approx(10.0)


def test_cameras_stand_where_they_look() -> None:
    shuffled = ("CAM_BACK", "CAM_FRONT_LEFT", "CAM_FRONT_RIGHT", "CAM_FRONT")
    places, rows, columns = camera_places(shuffled)
    assert (places, rows, columns) == ([(1, 1), (0, 0), (0, 2), (0, 1)], 2, 3)
    assert camera_places(CAMERAS[3:])[:2] == ([(0, 0), (0, 1), (0, 2)], 1)
    assert camera_places(("a", "b")) == ([(0, 0), (0, 1)], 1, 2)
    assert camera_places(tuple("abcdefgh"))[1:] == (2, 4)
    assert len(set(camera_places(tuple("abcdefghijk"))[0])) == 11


@pytest.mark.parametrize("num_cameras", [1, 7])
def test_other_rigs_are_drawn(num_cameras: int, tmp_path: Path) -> None:
    view = make_view(
        images=np.zeros((num_cameras, 64, 176, 3), np.uint8),
        pixel_from_camera=np.tile(PIXEL_FROM_CAMERA, (num_cameras, 1, 1)),
        ego_from_camera=np.tile(looking(0.0), (num_cameras, 1, 1)),
        camera_names=tuple(f"cam{i}" for i in range(num_cameras)),
    )
    path = save_figure(render_sample(view), tmp_path / "rig.png", dpi=40.0)
    picture = mpl_image.imread(path)
    assert picture.std() > 0.05


def test_pieces_that_do_not_belong_together_are_refused() -> None:
    with pytest.raises(ValueError, match="3 cameras needs"):
        make_view(camera_names=("a", "b", "c"))
    with pytest.raises(ValueError, match="cost map has"):
        make_view(cost_map=np.zeros((10, 50)))
    with pytest.raises(ValueError, match="together or not at all"):
        make_view(probabilities=None)
    with pytest.raises(REFUSED, match="probabilities"):
        make_view(probabilities=np.ones(2))
    with pytest.raises(REFUSED, match="driven"):
        make_view(driven=np.zeros((12, 2)))


def test_cost_range_ignores_outliers_and_survives_flat_maps() -> None:
    cost_map = np.linspace(0.0, 1.0, 10_000).reshape(100, 100)
    cost_map[0, 0], cost_map[0, 1] = 1e6, np.nan
    assert cost_range(cost_map) == pytest.approx((0.02, 0.98), abs=1e-3)
    low, high = cost_range(np.full((4, 4), 3.0))
    assert low < 3.0 < high
    assert cost_range(np.full((4, 4), np.nan)) == (0.0, 1.0)


def test_close_up_holds_all_paths_in_its_proportions() -> None:
    paths_m = [from_origin(straight(4.0, 0.7)), from_origin(straight(3.0, -0.2))]
    extent = close_extent(paths_m, 0.5)
    for x_m, y_m in np.concatenate(paths_m):
        assert extent.x_min_m < x_m < extent.x_max_m
        assert extent.y_min_m < y_m < extent.y_max_m
    width_m = extent.y_max_m - extent.y_min_m
    assert width_m / (extent.x_max_m - extent.x_min_m) == pytest.approx(0.5)
    still = close_extent([np.zeros((21, 2))], 0.5)
    assert still.x_max_m - still.x_min_m == 15.0


def test_whole_extent_is_the_grid_when_paths_stay_on_it() -> None:
    extent = whole_extent(BevGrid(), [from_origin(straight(9.0))])
    assert (extent.x_min_m, extent.x_max_m, extent.y_min_m, extent.y_max_m) == (-50, 50, -50, 50)


def test_ego_footprint_stands_on_its_rear_axle() -> None:
    axes = Figure().add_subplot()
    draw_ego(axes)
    (car,) = axes.patches
    corners = car.get_path().get_extents()
    assert (corners.y0, corners.y1) == pytest.approx((-1.0, 3.1))
    assert (corners.x0, corners.x1) == pytest.approx((-0.925, 0.925))


def test_saving_is_the_same_bytes_again(tmp_path: Path, figure: Figure) -> None:
    first = save_figure(figure, tmp_path / "a.png", dpi=40.0).read_bytes()
    again = save_figure(render_sample(make_view()), tmp_path / "b.png", dpi=40.0).read_bytes()
    assert again == first
