import numpy as np
import pytest

from lss_core.data.annotations.boxes import Boxes
from lss_core.geometry import apply, invert, rigid_from_yaw
from shoot.evaluation.box_moments import BoxMoments, find_moments, touched
from shoot.footprint import (
    EGO_LENGTH_M,
    EGO_WIDTH_M,
    footprint_centres,
    headings,
    rectangles_overlap,
)

AHEAD_S = 0.25 * np.arange(1, 21)
# Real time stamps are as large.
T0_S = 1_532_402_927.6


def _boxes(tracks: list[tuple[int, np.ndarray]]) -> Boxes:
    """Of (scene, rows of time after `T0_S`, x, y, yaw)."""
    rows = np.concatenate([track for _, track in tracks])
    return Boxes(
        scene=np.array([scene for scene, _ in tracks]),
        category=np.array(["vehicle.car"] * len(tracks)),
        size_m=np.array([[4.0 + number, 1.5] for number in range(len(tracks))]),
        start=np.cumsum([0, *(len(track) for _, track in tracks)]),
        time_s=T0_S + rows[:, 0],
        xy_m=rows[:, 1:3],
        yaw_rad=rows[:, 3],
        annotated=np.ones(9, dtype=bool),
    )


def _one(track: np.ndarray, time_s: float = 0.0, ahead_s: np.ndarray = AHEAD_S) -> BoxMoments:
    """Moments of one box, seen from one sample at the origin of `global`."""
    return find_moments(
        _boxes([(0, track)]),
        np.array([0]),
        np.array([T0_S + time_s]),
        np.zeros((1, 2)),
        np.zeros(1),
        ahead_s,
    )


def test_position_is_linear_and_heading_takes_the_shorter_way() -> None:
    track = np.array([[0.0, 10.0, 4.0, np.radians(170)], [1.0, 14.0, 0.0, np.radians(-150)]])
    moments = _one(track)
    # The last annotation is at 1 s: later the box is not there.
    assert moments.step.tolist() == [0, 1, 2, 3]
    expected = [[11.0, 3.0], [12.0, 2.0], [13.0, 1.0], [14.0, 0.0]]
    np.testing.assert_allclose(moments.xy_m, expected, atol=1e-5)
    np.testing.assert_allclose(np.degrees(moments.yaw_rad), [180.0, 190.0, 200.0, 210.0], atol=1e-3)


def test_a_box_is_there_between_its_annotations_only() -> None:
    track = np.array([[1.0, 5.0, 5.0, 0.0], [1.5, 5.0, 5.0, 0.0], [2.6, 5.0, 5.0, 0.0]])
    assert AHEAD_S[_one(track).step].tolist() == [1.0, 1.25, 1.5, 1.75, 2.0, 2.25, 2.5]
    assert AHEAD_S[_one(track, time_s=2.0).step].tolist() == [0.25, 0.5]
    assert len(_one(track, time_s=3.0).step) == 0
    # Somebody seen once is there at that moment.
    assert AHEAD_S[_one(track[:1]).step].tolist() == [1.0]


def test_boxes_are_seen_from_the_sample() -> None:
    xy_m, yaw_rad = np.array([[400.0, 900.0], [410.0, 880.0]]), np.array([0.7, -2.5])
    boxes = _boxes([(4, np.array([[0.0, 405.0, 907.0, 1.1], [9.0, 405.0, 907.0, 1.1]]))])
    moments = find_moments(boxes, np.array([4, 4]), T0_S + np.zeros(2), xy_m, yaw_rad, AHEAD_S[:1])
    for row in range(2):
        ego_from_global = invert(rigid_from_yaw(xy_m[row], yaw_rad[row]))
        there = apply(ego_from_global, np.array([[405.0, 907.0, 0.0]]))[0, :2]
        np.testing.assert_allclose(moments.xy_m[moments.sample == row], [there], atol=1e-5)
    np.testing.assert_allclose(moments.yaw_rad, [0.4, 3.6], atol=1e-6)


def test_samples_see_the_boxes_of_their_scene() -> None:
    still = np.array([[0.0, 0.0, 0.0, 0.0], [9.0, 0.0, 0.0, 0.0]])
    boxes = _boxes([(2, still), (5, still), (5, still + np.array([0.0, 1.0, 1.0, 0.0]))])
    scene = np.array([5, 2, 7, 5])
    moments = find_moments(
        boxes, scene, np.full(4, T0_S), np.zeros((4, 2)), np.zeros(4), AHEAD_S[:2]
    )
    seen = {sample: set(moments.box[moments.sample == sample].tolist()) for sample in range(4)}
    assert seen == {0: {1, 2}, 1: {0}, 2: set(), 3: {1, 2}}
    assert set(moments.size_m[moments.box == 2][:, 0].tolist()) == {6.0}


@pytest.fixture
def crowd() -> BoxMoments:
    """Some 50 boxes round each of 6 samples."""
    rng = np.random.default_rng(0)
    num = 6000
    return BoxMoments(
        sample=rng.integers(0, 6, num),
        step=rng.integers(0, 20, num),
        box=rng.integers(0, 50, num),
        xy_m=rng.normal(0.0, 12.0, (num, 2)).astype(np.float32),
        yaw_rad=rng.uniform(-3.0, 3.0, num).astype(np.float32),
        size_m=rng.uniform([0.5, 0.5], [12.0, 3.0], (num, 2)).astype(np.float32),
    )


def test_touched_is_every_pair_compared(crowd: BoxMoments) -> None:
    rng = np.random.default_rng(1)
    paths_m = np.cumsum(rng.normal([0.7, 0.0], 0.5, (6, 20, 2)), axis=1)
    heading_rad = headings(paths_m)
    at = crowd.sample, crowd.step
    slow = rectangles_overlap(
        footprint_centres(paths_m, heading_rad)[at],
        heading_rad[at],
        np.array([EGO_LENGTH_M, EGO_WIDTH_M]),
        crowd.xy_m,
        crowd.yaw_rad,
        crowd.size_m,
    )
    assert 0.02 < slow.mean() < 0.5
    hit = touched(crowd, paths_m, heading_rad)
    # float32 may decide otherwise where rectangles touch within a tenth of a millimetre.
    assert (hit != slow).mean() < 1e-3


def test_no_boxes_touch_nothing() -> None:
    boxes = _boxes([(0, np.array([[50.0, 0.0, 0.0, 0.0]]))])
    nobody = find_moments(
        boxes, np.array([3]), np.array([T0_S]), np.zeros((1, 2)), np.zeros(1), AHEAD_S
    )
    assert len(nobody.sample) == 0
    assert touched(nobody, np.zeros((1, 20, 2)), np.zeros((1, 20))).shape == (0,)
