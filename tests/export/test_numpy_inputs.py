"""What NumPy alone makes of calibration: the index and the crops that training knows."""

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from exported_run import Exported
from hypothesis import given
from hypothesis import strategies as st

from lss_core.camera import horizon_row
from lss_core.config import ImageConfig
from lss_core.data.sensors.images import draw_pixel_map
from shoot.export.card import make_card
from shoot.export.graph import PlannerGraph
from shoot.export.numpy_inputs import choose_crop, make_splat_index
from shoot.export.samples import inputs_of
from shoot.training.planning.task import PlanningModule

AHEAD = np.array(
    [[0.0, 0.0, 1.0, 1.2], [-1.0, 0.0, 0.0, 0.3], [0.0, -1.0, 0.0, 1.5], [0.0, 0.0, 0.0, 1.0]]
)
CARD: dict[str, Any] = {
    "features": {"rows_px": [3.5, 11.5], "columns_px": [3.5, 11.5, 19.5], "depths_m": [4.0, 9.0]},
    "grid": {
        "x_min_m": 0.0,
        "y_min_m": -2.0,
        "cell_m": 1.0,
        "num_x": 8,
        "num_y": 6,
        "z_min_m": 0.0,
        "z_max_m": 3.0,
    },
}
# Feature cell (row 1, column 2) looks 8 px to the right of the axis and 4 px below it.
INTRINSICS = np.array([[16.0, 0.0, 11.5], [0.0, 16.0, 7.5], [0.0, 0.0, 1.0]])


def test_a_point_worked_out_by_hand() -> None:
    """At 4 m the cell's ray is 2 m to the right and 1 m down: x 5.2, y -1.7, z 0.5."""
    index = make_splat_index(CARD, INTRINSICS[None], AHEAD[None])
    points = {(int(p), int(d)): int(c) for p, d, c in index.T}
    assert points[5, 0] == 5 * 6 + 0
    # The cell above it looks up as far: z 2.5; and at 9 m all points are beyond the grid's front.
    assert points[2, 0] == 5 * 6 + 0
    assert {d for _, d in points} == {0}
    assert list(index[2]) == sorted(index[2])


def test_edges_below_are_in_and_above_are_out() -> None:
    pose = AHEAD.copy()
    pose[:3, 3] = [4.0, 0.0, 0.0]  # 4 m ahead of it is the grid's front, at 8 m
    assert make_splat_index(CARD, INTRINSICS[None], pose[None]).shape == (3, 0)
    pose[0, 3] = -4.0  # and here its rear, at 0 m
    cells = make_splat_index(CARD, INTRINSICS[None], pose[None])[2]
    # Level to the right: y -2 is in, z 1 up; the row below looks under the ground.
    assert 0 in cells
    assert cells.max() < 6 * 6


@pytest.mark.parametrize("missing", [(), (1,), (0, 2)])
def test_the_index_is_the_one_of_training(exported: Exported, missing: tuple[int, ...]) -> None:
    sensors = exported.without(*missing)
    num_depths = len(exported.card["features"]["depths_m"])
    for b in range(3):
        _same_index(exported.graph, exported.card, sensors, b, num_depths)


@pytest.mark.parametrize("frustum", ["cell", "released"])
def test_whatever_feature_cells_stand_for(exported: Exported, frustum: str) -> None:
    config = exported.run.config
    config = replace(config, model=replace(config.model, frustum=frustum))
    graph = PlannerGraph(PlanningModule(config, exported.run.templates))
    card = make_card(replace(exported.run, config=config), graph)
    assert card["features"] != exported.card["features"]
    _same_index(graph, card, exported.sensors, 0, len(card["features"]["depths_m"]))


def _same_index(
    graph: PlannerGraph, card: dict[str, Any], sensors: Any, b: int, num_depths: int
) -> None:
    one = slice(b, b + 1)
    expected = graph.model.splat_index(
        sensors.pixel_from_camera[one], sensors.ego_from_camera[one], sensors.camera_mask[one]
    )
    pixel_idx, depth_idx, cell_idx = inputs_of(card, sensors, b)["splat_index"]
    point_idx = pixel_idx * num_depths + depth_idx
    count = int(expected.inside.sum())
    assert count > 100
    np.testing.assert_array_equal(point_idx, expected.point_idx[:count].numpy())
    np.testing.assert_array_equal(cell_idx, expected.cell_of.flatten().numpy()[point_idx])


def test_a_calibration_that_is_none_lies_nowhere() -> None:
    intrinsics = np.stack([INTRINSICS, np.zeros((3, 3))])
    index = make_splat_index(CARD, intrinsics, np.stack([AHEAD, AHEAD]))
    np.testing.assert_array_equal(index, make_splat_index(CARD, INTRINSICS[None], AHEAD[None]))


def test_a_list_of_fixed_length_has_the_same_points() -> None:
    index = make_splat_index(CARD, INTRINSICS[None], AHEAD[None])
    filled = make_splat_index(CARD, INTRINSICS[None], AHEAD[None], num_points=12)
    num = index.shape[1]
    np.testing.assert_array_equal(filled[:, :num], index)
    assert set(filled[2, num:]) == {8 * 6}
    with pytest.raises(ValueError, match=f"{num} points lie on the grid, more than {num - 1}"):
        make_splat_index(CARD, INTRINSICS[None], AHEAD[None], num_points=num - 1)


def test_shapes_that_do_not_belong_together_are_refused() -> None:
    with pytest.raises(ValueError, match=r"Expected \[N, 3, 3\]"):
        make_splat_index(CARD, INTRINSICS, AHEAD[None])
    with pytest.raises(ValueError, match="a mask"):
        make_splat_index(CARD, INTRINSICS[None], AHEAD[None], [True, True])


@given(
    raw_hw=st.tuples(st.integers(20, 1200), st.integers(20, 1800)),
    crop_bottom=st.floats(0.0, 0.6),
    pitch_rad=st.floats(-0.8, 0.8),
    turned=st.booleans(),
    horizon=st.tuples(st.floats(0.0, 0.5), st.floats(0.0, 0.5)),
)
def test_crops_are_those_of_evaluation(
    raw_hw: tuple[int, int],
    crop_bottom: float,
    pitch_rad: float,
    turned: bool,
    horizon: tuple[float, float],
) -> None:
    config = ImageConfig(64, 176, crop_bottom=(crop_bottom, crop_bottom), horizon=horizon)
    card = {
        "images": {"height_px": 64, "width_px": 176, "crop_bottom": crop_bottom, "horizon": horizon}
    }
    height, width = raw_hw
    intrinsics = np.array(
        [[0.7 * width, 0, 0.49 * width], [0, 0.8 * width, 0.52 * height], [0, 0, 1]]
    )
    cos, sin = np.cos(pitch_rad), np.sin(pitch_rad)
    nod = np.array([[cos, 0.0, sin], [0.0, 1.0, 0.0], [-sin, 0.0, cos]])
    pose = AHEAD.copy()
    pose[:3, :3] = nod @ AHEAD[:3, :3]
    if turned:  # the camera lies on its side
        pose[:3, :3] = pose[:3, [1, 0, 2]] * [1.0, -1.0, 1.0]
    expected = draw_pixel_map(config, raw_hw, None, horizon_row(intrinsics, pose))
    crop = choose_crop(card, raw_hw, intrinsics, pose)
    left, top = expected.left_px, expected.top_px
    assert crop.resized_wh == expected.resized_hw[::-1]
    assert crop.box == (left, top, left + 176, top + 64)
    np.testing.assert_allclose(crop.pixel_from_rawpixel, expected.pixel_from_rawpixel, atol=1e-9)


def test_a_card_is_the_same_after_it_was_json(exported: Exported) -> None:
    assert json.loads(json.dumps(exported.card)) == exported.card
