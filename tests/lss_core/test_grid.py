"""Metres become cells by one rule: lower edge in, upper edge out, floor."""

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from lss_core.grid import BevGrid

GRID = BevGrid()


@pytest.mark.parametrize(
    ("xy_m", "cell"),
    [
        ((-50.0, -50.0), (0, 0)),  # the lower border belongs to the first cell
        ((-49.51, 0.0), (0, 100)),
        ((-49.5, 0.01), (1, 100)),
        ((-0.2, -0.2), (99, 99)),  # truncation toward zero would not tell this from (100, 100)
        ((0.2, 12.34), (100, 124)),
        ((49.99, 49.99), (199, 199)),
    ],
)
def test_cell_of_a_point_by_hand(xy_m: tuple[float, float], cell: tuple[int, int]) -> None:
    cells, inside = GRID.cells(torch.tensor(xy_m))
    assert inside
    assert tuple(cells.tolist()) == cell


@pytest.mark.parametrize(
    "xy_m",
    [
        (-50.4, 0.0),  # truncation folds this one into cell 0
        (0.0, -50.01),
        (50.0, 0.0),
        (0.0, 50.0),
        (float("nan"), 0.0),
        (0.0, float("inf")),
        (float("-inf"), 0.0),
    ],
)
def test_points_outside_are_outside(xy_m: tuple[float, float]) -> None:
    _, inside = GRID.cells(torch.tensor(xy_m))
    assert not inside


def test_centres_are_half_a_cell_from_the_borders_and_in_their_own_cells() -> None:
    grid = BevGrid(-10.0, 70.0, -40.0, 40.0, 1.0)
    centres_m = grid.centres()
    assert centres_m.shape == (80, 80, 2)
    assert centres_m[0, 0].tolist() == [-9.5, -39.5]
    assert centres_m[79, 3].tolist() == [69.5, -36.5]
    cells, inside = grid.cells(centres_m)
    assert inside.all()
    assert torch.equal(cells[..., 0], torch.arange(80)[:, None].expand(80, 80))
    assert torch.equal(cells[..., 1], torch.arange(80)[None].expand(80, 80))


@given(st.integers(0, 199), st.integers(0, 199), st.floats(0.01, 0.99), st.floats(0.01, 0.99))
def test_a_point_within_a_cell_is_in_that_cell(
    x: int, y: int, part_x: float, part_y: float
) -> None:
    xy_m = torch.tensor([-50.0 + 0.5 * (x + part_x), -50.0 + 0.5 * (y + part_y)])
    cells, inside = GRID.cells(xy_m)
    assert inside
    assert cells.tolist() == [x, y]


@pytest.mark.parametrize(
    ("low_m", "high_m", "cell_m", "count"),
    # Integer truncation of these quotients gives 2, 666 and 256.
    [(0.0, 0.3, 0.1, 3), (-50.0, 50.0, 0.15625, 640), (-17.0, 60.1, 0.3, 257)],
)
def test_cell_counts_are_rounded_not_truncated(
    low_m: float, high_m: float, cell_m: float, count: int
) -> None:
    assert BevGrid(low_m, high_m, low_m, high_m, cell_m).shape == (count, count)


@pytest.mark.parametrize(
    ("sides", "word"),
    [
        ((-50.0, 50.0, -50.0, 50.0, 0.3), "whole number"),
        ((5.0, 5.0, -1.0, 1.0, 1.0), "whole number"),
        ((5.0, -5.0, -1.0, 1.0, 1.0), "whole number"),
        ((-1.0, 1.0, -1.0, 1.0, 0.0), "more than 0"),
    ],
)
def test_grids_that_are_none_are_refused(sides: tuple[float, ...], word: str) -> None:
    with pytest.raises(ValueError, match=word):
        BevGrid(*sides)
