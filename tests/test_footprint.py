import numpy as np
import pytest
import shapely

from shoot.footprint import (
    EGO_LENGTH_M,
    EGO_REAR_M,
    EGO_WIDTH_M,
    footprint_centres,
    footprint_corners,
    headings,
    rectangles_overlap,
    turn,
)

EGO_SIZE_M = np.array([EGO_LENGTH_M, EGO_WIDTH_M])


def _arc(radius_m: float, speed_mps: float, num: int = 20) -> tuple[np.ndarray, np.ndarray]:
    """A path on a circle to the left (to the right for a negative radius), and its tangents."""
    angle = speed_mps * 0.25 * np.arange(1, num + 1) / radius_m
    return radius_m * np.stack([np.sin(angle), 1.0 - np.cos(angle)], axis=-1), angle


def _polygon(centre_m: np.ndarray, yaw_rad: float, size_m: np.ndarray) -> shapely.Polygon:
    corners_m = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * size_m / 2
    return shapely.Polygon(centre_m + turn(corners_m, np.full(4, yaw_rad)))


@pytest.mark.parametrize("radius_m", [30.0, -12.0])
@pytest.mark.parametrize("speed_mps", [2.0, 8.0])
def test_heading_on_a_circle_is_its_tangent(radius_m: float, speed_mps: float) -> None:
    path_m, tangent_rad = _arc(radius_m, speed_mps)
    heading_rad = headings(path_m)
    difference_rad = np.angle(np.exp(1j * (heading_rad - tangent_rad)))
    assert np.abs(difference_rad[:-1]).max() < 1e-9
    # The last point has no point after it: the chord lags by half a step.
    assert difference_rad[-1] == pytest.approx(-speed_mps * 0.125 / radius_m)


def test_standing_car_keeps_its_heading() -> None:
    rng = np.random.default_rng(0)
    path_m, tangent_rad = _arc(10.0, 5.0, num=8)
    stopped_m = path_m[-1] + rng.normal(0.0, 0.01, (12, 2))
    heading_rad = headings(np.concatenate([path_m, stopped_m]))
    np.testing.assert_allclose(heading_rad[9:], heading_rad[8], atol=1e-12)
    assert heading_rad[9] == pytest.approx(tangent_rad[-1], abs=0.1)
    never_m = rng.normal(0.0, 0.01, (20, 2))
    assert (headings(never_m) == 0.0).all()


def test_car_that_backs_up_does_not_turn_round() -> None:
    back_m = np.stack([-0.5 * np.arange(1, 21), np.zeros(20)], axis=-1)
    np.testing.assert_allclose(headings(back_m), 0.0, atol=1e-12)
    # Forward to the left, then back along the same arc: there and back, the same headings.
    path_m, _ = _arc(15.0, 4.0, num=10)
    there_and_back = headings(np.concatenate([path_m, path_m[-2::-1]]))
    np.testing.assert_allclose(there_and_back[10:18], there_and_back[8:0:-1], atol=1e-9)


def test_headings_of_many_are_those_of_each() -> None:
    steps_m = np.random.default_rng(1).normal([0.6, 0.0], 0.4, (5, 3, 20, 2))
    paths_m = np.cumsum(steps_m, axis=-2)
    one_by_one = [[headings(path) for path in group] for group in paths_m]
    np.testing.assert_array_equal(headings(paths_m), one_by_one)
    assert headings(paths_m[:0]).shape == (0, 3, 20)


def test_corners_of_a_car_that_faces_left() -> None:
    corners_m = footprint_corners(np.array([7.0, 2.0]), np.array(np.pi / 2))
    expected = [[6.075, 5.1], [6.075, 1.0], [7.925, 1.0], [7.925, 5.1]]
    np.testing.assert_allclose(corners_m, expected, atol=1e-12)


def test_centres_are_the_means_of_the_corners() -> None:
    rng = np.random.default_rng(2)
    paths_m, heading_rad = rng.normal(0.0, 9.0, (4, 6, 2)), rng.uniform(-4.0, 4.0, (4, 6))
    corners_m = footprint_corners(paths_m, heading_rad)
    np.testing.assert_allclose(
        footprint_centres(paths_m, heading_rad), corners_m.mean(axis=-2), atol=1e-12
    )
    # The rear axle lies on the long axis, `EGO_REAR_M` ahead of the rear bumper.
    rear_m = corners_m[..., 1:3, :].mean(axis=-2)
    np.testing.assert_allclose(np.linalg.norm(paths_m - rear_m, axis=-1), EGO_REAR_M)


def test_overlap_is_shapelys() -> None:
    rng = np.random.default_rng(3)
    num = 3000
    centres_m = rng.normal(0.0, 2.5, (2, num, 2))
    yaws_rad, sizes_m = rng.uniform(-7.0, 7.0, (2, num)), rng.uniform(0.2, 6.0, (2, num, 2))
    ours = rectangles_overlap(
        centres_m[0], yaws_rad[0], sizes_m[0], centres_m[1], yaws_rad[1], sizes_m[1]
    )
    first, second = (
        [_polygon(*row) for row in zip(centres_m[i], yaws_rad[i], sizes_m[i], strict=True)]
        for i in range(2)
    )
    theirs = shapely.intersects(first, second)
    assert 0.3 < theirs.mean() < 0.9
    np.testing.assert_array_equal(ours, theirs)


def test_overlap_of_one_inside_the_other_and_of_two_crossing() -> None:
    def overlap(size_m: list[float], other_size_m: list[float]) -> bool:
        place_m, yaw_rad = np.array([[3.0, 4.0]]), np.array([0.4])
        both = rectangles_overlap(
            place_m, yaw_rad, np.array(size_m), place_m, yaw_rad, np.array(other_size_m)
        )
        return bool(both[0])

    assert overlap([4.0, 2.0], [0.1, 0.1])
    assert overlap([0.1, 0.1], [4.0, 2.0])
    # A cross: no corner of one lies in the other.
    assert overlap([9.0, 1.0], [1.0, 9.0])


def test_touching_is_no_overlap() -> None:
    square = np.array([2.0, 2.0])
    for gap_m, expected in ((-0.001, True), (0.0, False), (0.001, False)):
        there_m, level = np.array([[2.0 + gap_m, 1.0]]), np.zeros(1)
        assert rectangles_overlap(np.zeros(2), level, square, there_m, level, square) == expected


@pytest.mark.parametrize(
    ("place_m", "level", "turned"),
    [((12.5, 10.2), True, False), ((12.0, 12.0), False, True)],
)
def test_footprint_turns_with_the_path(
    place_m: tuple[float, float], level: bool, turned: bool
) -> None:
    heading_rad = np.array([0.0, np.pi / 4])
    centres_m = footprint_centres(np.full((2, 2), 10.0), heading_rad)
    hits = rectangles_overlap(
        centres_m, heading_rad, EGO_SIZE_M, np.array(place_m), np.zeros(2), np.array([0.2, 0.2])
    )
    assert hits.tolist() == [level, turned]


@pytest.mark.parametrize("speed_mps", [0.3, 0.6, 5.0])
def test_the_same_path_in_finer_steps_has_the_same_headings(speed_mps: float) -> None:
    """Whether a car stands is a matter of its speed, not of how often it is looked at."""
    angle = speed_mps * 0.05 * np.arange(1, 101) / 8.0
    fine_m = 8.0 * np.stack([np.sin(angle), 1.0 - np.cos(angle)], axis=-1)
    fine_rad, coarse_rad = headings(fine_m, 0.05), headings(fine_m[4::5], 0.25)
    np.testing.assert_allclose(fine_rad[4:-1:5], coarse_rad[:-1], atol=1e-6)
    assert (coarse_rad == 0.0).all() == (speed_mps < 0.4)
