"""Pictures of a segmentation: dots where cells are seen, colours by class, forward is up."""

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

from lss_core.grid import BevGrid
from shoot.rendering import SegmentationView, palette, render_segmentation
from shoot.rendering.segmentation_view import blend_classes, order_of_layers, topmost_class

# A camera 1.5 m above the ego origin that looks forward: (x, y, 0) is seen at
# u = 80 - 100 y / x, v = 60 + 150 / x.
PIXEL_FROM_CAMERA = np.array([[100.0, 0.0, 80.0], [0.0, 100.0, 60.0], [0.0, 0.0, 1.0]])
EGO_FROM_CAMERA = np.array(
    [[0.0, 0.0, 1.0, 0.0], [-1.0, 0.0, 0.0, 0.0], [0.0, -1.0, 0.0, 1.5], [0.0, 0.0, 0.0, 1.0]]
)
GRID = BevGrid(-20.0, 20.0, -10.0, 10.0, 2.0)
CLASSES = ("car", "drivable")
REFUSED = (ValueError, TypeError)  # shape types, active in tests, may speak first


def make_view(**changes: object) -> SegmentationView:
    """A car at (11, 3) and another one behind; road at (5, -1), under the car, and beside."""
    prob = np.zeros((2, *GRID.shape))
    prob[0, 15, 6] = 0.9  # x = 11, y = 3
    prob[0, 2, 6] = 0.9  # behind
    prob[1, 15, 6] = 0.8
    prob[1, 12, 4] = 0.7  # x = 5, y = -1
    prob[1, 13, 4] = 0.4  # less probable than not
    fields: dict[str, object] = {
        "images": np.full((1, 1200, 1600, 3), 128, np.uint8),
        "pixel_from_camera": PIXEL_FROM_CAMERA[None],
        "ego_from_camera": EGO_FROM_CAMERA[None],
        "camera_names": ("CAM_FRONT",),
        "grid": GRID,
        "classes": CLASSES,
        "probabilities": prob,
        "truth": (prob > 0.75).astype(np.uint8),
        "iou": (100.0, float("nan")),
        "title": "scene of $5",
    }
    return SegmentationView(**{**fields, **changes})  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def figure() -> Figure:
    return render_segmentation(make_view())


def test_dots_lie_on_the_ground_in_the_cells_seen(figure: Figure) -> None:
    (dots,) = [it for it in figure.axes[0].collections if it.get_gid() == "cells"]
    # The far one first, so that near ones cover it; what is behind is not seen.
    expected = [[80 - 300 / 11, 60 + 150 / 11], [80 + 100 / 5, 60 + 150 / 5]]
    np.testing.assert_allclose(np.asarray(dots.get_offsets()), expected)
    colours = [tuple(colour[:3]) for colour in dots.get_facecolors()]
    assert colours == [to_rgb(palette.CLASSES["car"]), to_rgb(palette.CLASSES["drivable"])]
    far, near = dots.get_sizes()
    assert far < near


def test_the_maps_stand_side_by_side_forward_up(figure: Figure) -> None:
    predicted, true = (axes for axes in figure.axes if axes.get_title())
    assert (predicted.get_title(), true.get_title()) == ("predicted", "true")
    for axes in (predicted, true):
        assert axes.get_xlim() == (10.0, -10.0)  # left is left
        assert axes.get_ylim() == (-20.0, 20.0)
    (shown,) = true.get_images()
    pixels = np.asarray(shown.get_array())
    assert tuple(pixels[15, 6]) == to_rgb(palette.CLASSES["car"])
    assert tuple(pixels[12, 4]) == (1.0, 1.0, 1.0)


def test_the_legend_says_how_well_classes_are_met(figure: Figure) -> None:
    texts = [text.get_text() for text in figure.legends[0].get_texts()]
    assert texts == ["car: IoU 100 %", "drivable", "ego vehicle"]


def test_cars_lie_on_vehicles_on_lanes_on_the_road() -> None:
    classes = ("tree", "car", "vehicle", "drivable", "lane_boundary")
    names = [classes[c] for c in order_of_layers(classes)]
    assert names == ["drivable", "lane_boundary", "vehicle", "car", "tree"]
    prob = np.array([0.6, 0.9])[:, None, None] * np.ones((2, 1, 2))
    prob[0, 0, 1] = 0.4
    assert topmost_class(prob, CLASSES, 0.5).tolist() == [[0, 1]]
    assert topmost_class(np.zeros((2, 1, 2)), CLASSES, 0.5).tolist() == [[-1, -1]]


def test_colours_fade_with_probability() -> None:
    half = blend_classes(np.array([[[0.0]], [[0.5]]]), CLASSES)[0, 0]
    np.testing.assert_allclose(half, 0.5 + 0.5 * np.array(to_rgb(palette.CLASSES["drivable"])))
    car = blend_classes(np.array([[[1.0]], [[1.0]]]), CLASSES)[0, 0]
    np.testing.assert_allclose(car, to_rgb(palette.CLASSES["car"]))


@pytest.mark.parametrize(
    "changes",
    [
        {"camera_names": ("a", "b")},
        {"truth": np.zeros((1, *GRID.shape), np.uint8)},
        {"probabilities": np.zeros((2, 3, 3))},
        {"iou": (1.0,)},
    ],
)
def test_what_does_not_belong_together_is_refused(changes: dict[str, object]) -> None:
    with pytest.raises(REFUSED):
        make_view(**changes)
