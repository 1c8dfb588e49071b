import logging
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from driving_world import (
    NUM_SAMPLES,
    NUM_TIMES,
    VERSION,
    WIDE_ROAD,
    Thing,
    config_of,
    keep_samples,
    label_split,
    replace_first,
    standing,
    straight,
    values_of_first,
    write_drive,
    write_road,
)
from tiny_tables import TRAIN_A, VAL

from lss_core.data.samples import SampleIndex
from shoot.evaluation.driving_checks import CHECK_HORIZONS_S, DrivingChecks
from shoot.footprint import (
    EGO_LENGTH_M,
    EGO_REAR_M,
    EGO_WIDTH_M,
    rectangles_overlap,
)
from shoot.training.planning.data import LabelledSplit


def _checks(root: Path, things: list[Thing], **more: Any) -> tuple[DrivingChecks, LabelledSplit]:
    data = config_of(write_drive(root, things))
    split = label_split(data, **more)
    return DrivingChecks(split, data), split


def _crossing(speed_mps: float, at_s: float, x_m: float = 20.0) -> Thing:
    """Somebody who crosses the driver's lane from the right, and its middle at `at_s`."""
    return Thing(lambda t: (x_m, speed_mps * (t - at_s), math.pi / 2))


def test_who_passes_before_or_after_does_not_collide(tmp_path: Path) -> None:
    # In the lane from 3.6 s to 4.4 s.
    checks, split = _checks(tmp_path, [_crossing(5.0, 4.0)])
    collisions = {
        speed_mps: values_of_first(checks, split, straight(speed_mps), "collision")
        for speed_mps in (10.0, 8.0, 5.0, 2.5)
    }
    assert collisions == {
        10.0: [0.0, 0.0, 0.0, 0.0],  # at x = 20 m after 2 s, long before
        8.0: [0.0, 0.0, 0.0, 0.0],
        5.0: [0.0, 0.0, 0.0, 100.0],  # there after 4 s
        2.5: [0.0, 0.0, 0.0, 0.0],  # not there within 5 s
    }


def test_who_is_there_between_keyframes_only_collides(tmp_path: Path) -> None:
    # Annotated at y = -5 m and at y = 5 m; in the lane at 3.75 s.
    checks, split = _checks(tmp_path, [_crossing(20.0, 3.75)])
    assert values_of_first(checks, split, straight(5.0), "collision") == [0.0, 0.0, 0.0, 100.0]


def test_each_horizon_counts_what_is_before_it(tmp_path: Path) -> None:
    # The front bumper is 3.1 m ahead of the axle; the boxes begin at x = 9.4 m and at 14.4 m.
    for speed_mps, expected in ((6.8, [100.0] * 4), (6.2, [0.0, 100.0, 100.0, 100.0])):
        folder = tmp_path / str(speed_mps)
        checks, split = _checks(folder, [standing(10.4, 3.0)])
        path_m = straight(speed_mps, offset_m=3.0)
        assert values_of_first(checks, split, path_m, "collision") == expected
    path_m = straight(2.0, offset_m=3.0)  # front bumper at 9.1 m after 3 s, 13.1 m after 5 s
    assert values_of_first(checks, split, path_m, "collision") == [0.0, 0.0, 0.0, 100.0]
    path_m = straight(1.0, offset_m=3.0)
    assert values_of_first(checks, split, path_m, "collision") == [0.0] * 4


def _level_hits(path_m: np.ndarray, place_m: tuple[float, float]) -> bool:
    """Whether a footprint that never turns would touch a small box."""
    centres_m = path_m + np.array([EGO_LENGTH_M / 2 - EGO_REAR_M, 0.0])
    hits = rectangles_overlap(
        centres_m,
        np.zeros(NUM_TIMES),
        np.array([EGO_LENGTH_M, EGO_WIDTH_M]),
        np.array(place_m),
        np.zeros(NUM_TIMES),
        np.array([0.2, 0.2]),
    )
    return bool(hits.any())


def test_a_turned_ego_fits_through_a_narrow_gap(tmp_path: Path) -> None:
    # Posts 1.2 m to both sides of a path at 45 degrees, 16 m along it.
    along_m, aside_m = 16.0, 1.2
    posts = [((along_m - side) / math.sqrt(2), (along_m + side) / math.sqrt(2))
             for side in (aside_m, -aside_m)]  # fmt: skip
    path_m = straight(8.0, math.pi / 4)
    assert all(_level_hits(path_m, place_m) for place_m in posts)
    things = [standing(*place_m, length_m=0.2, width_m=0.2) for place_m in posts]
    checks, split = _checks(tmp_path, things)
    assert values_of_first(checks, split, path_m, "collision") == [0.0] * 4


def test_a_turned_ego_hits_what_a_level_one_would_not(tmp_path: Path) -> None:
    # Straight ahead of the nose where the path ends; a level footprint passes to its right.
    path_m = straight(3.0, math.pi / 4)
    place_m = tuple(path_m[-1] + 2.9 / math.sqrt(2))
    assert not _level_hits(path_m, place_m)
    checks, split = _checks(tmp_path, [standing(*place_m, length_m=0.2, width_m=0.2)])
    assert values_of_first(checks, split, path_m, "collision") == [0.0, 0.0, 0.0, 100.0]


def test_people_count_and_barriers_do_not(tmp_path: Path) -> None:
    for category, expected in (
        ("human.pedestrian.adult", 100.0),
        ("vehicle.truck", 100.0),
        ("movable_object.barrier", 0.0),
        ("animal", 0.0),
    ):
        thing = standing(12.0, 6.0, category=category)
        checks, split = _checks(tmp_path / category, [thing])
        values = values_of_first(checks, split, straight(5.0, offset_m=6.0), "collision")
        assert values[-1] == expected


def test_a_box_that_the_driver_touches_is_left_out_and_counted(tmp_path: Path) -> None:
    checks, split = _checks(tmp_path, [standing(20.0, 0.0), _crossing(5.0, 4.0, x_m=12.0)])
    # Samples are 5 m apart. That at x = 25 m has its rear bumper at 24 m, the box ends at 21 m.
    assert (checks.num_boxes_left_out, checks.num_samples_affected) == (5, 5)
    # It does not count for a path that runs into it at another time, here after 4 s or more.
    assert values_of_first(checks, split, straight(4.0), "collision")[-1] == 0.0
    # Another box still does, at the very time steps.
    assert values_of_first(checks, split, straight(3.0), "collision")[-1] == 100.0


def test_for_samples_past_it_the_same_box_counts(tmp_path: Path) -> None:
    checks, split = _checks(tmp_path, [standing(20.0, 0.0)])
    paths_m = split.futures.xy_m.copy()
    paths_m[4:] = straight(-1.5)  # back from x = 20 m, 25 m and 30 m
    values = checks(paths_m)["collision_5s"]
    assert values.tolist() == [0.0, 0.0, 0.0, 0.0, 0.0, 100.0, 0.0]


def test_a_box_on_the_ego_at_the_sample_is_left_out(tmp_path: Path) -> None:
    # It ends 0.5 m ahead of the rear bumper, and stays when the driver leaves.
    checks, split = _checks(tmp_path, [standing(-1.5, 0.0)])
    assert (checks.num_boxes_left_out, checks.num_samples_affected) == (1, 1)
    assert values_of_first(checks, split, np.zeros((NUM_TIMES, 2)), "collision") == [0.0] * 4
    # Just behind the bumper it is no error of the annotation, and standing is no collision.
    checks, split = _checks(tmp_path / "behind", [standing(-2.1, 0.0)])
    assert checks.num_boxes_left_out == 0
    assert values_of_first(checks, split, np.zeros((NUM_TIMES, 2)), "collision") == [0.0] * 4
    assert values_of_first(checks, split, straight(-1.0), "collision") == [100.0] * 4


def test_two_boxes_of_a_sample_are_two_boxes_and_one_sample(tmp_path: Path) -> None:
    checks, _ = _checks(tmp_path, [standing(1.0, 0.5), standing(1.5, -0.5)])
    assert (checks.num_boxes_left_out, checks.num_samples_affected) == (2, 1)


def test_the_driver_never_collides(tmp_path: Path) -> None:
    things = [standing(20.0, 0.0), standing(33.0, 0.9, 0.4), _crossing(5.0, 2.0)]
    checks, split = _checks(tmp_path, things)
    values = checks(split.futures.xy_m)
    assert checks.num_boxes_left_out > NUM_SAMPLES
    assert sorted(values) == [f"collision_{horizon_s}s" for horizon_s in CHECK_HORIZONS_S]
    for value in values.values():
        assert value.tolist() == [0.0] * NUM_SAMPLES


def test_nothing_is_known_beyond_the_annotations(tmp_path: Path) -> None:
    # Keyframes end after 4 s; samples are at 0 s, 0.5 s ... 3 s.
    checks, split = _checks(
        tmp_path, [standing(12.0, 6.0)], change=lambda index: keep_samples(index, 9)
    )
    paths_m = replace_first(split, straight(5.0, offset_m=6.0))
    values = checks(paths_m)
    known = {
        horizon_s: np.isfinite(values[f"collision_{horizon_s}s"]).tolist()
        for horizon_s in CHECK_HORIZONS_S
    }
    assert known == {
        1: [True] * 7,
        2: [True] * 5 + [False] * 2,
        3: [True] * 3 + [False] * 4,
        5: [False] * 7,
    }
    assert values["collision_3s"][0] == 100.0


@pytest.mark.parametrize(("missing_s", "is_known"), [(0.25, True), (0.26, False)])
def test_a_quarter_of_a_second_may_be_missing(
    tmp_path: Path, missing_s: float, is_known: bool
) -> None:
    def shorten(index: SampleIndex) -> SampleIndex:
        kept = keep_samples(index, 11)
        time_s = kept.time_s.copy()
        time_s[-1] -= missing_s
        return replace(kept, time_s=time_s)

    checks, split = _checks(tmp_path, [standing(12.0, 6.0)], change=shorten)
    assert np.isfinite(checks(split.futures.xy_m)["collision_5s"][0]) == is_known


def test_a_scene_without_annotations_is_not_known(tmp_path: Path) -> None:
    scenes = (VAL, replace(TRAIN_A, name="scene-0012"))
    data = config_of(write_drive(tmp_path, [standing(12.0, 6.0)], scenes))
    split = label_split(data)
    values = DrivingChecks(split, data)(split.futures.xy_m)["collision_1s"]
    assert np.isfinite(values).tolist() == (split.scene_names == VAL.name).tolist()
    assert np.isnan(values).sum() == NUM_SAMPLES


@pytest.mark.parametrize("table", ["sample_annotation", "instance", "category"])
def test_without_a_table_collisions_are_left_out(
    tmp_path: Path, table: str, caplog: pytest.LogCaptureFixture
) -> None:
    data = config_of(write_drive(tmp_path, [standing(12.0, 6.0)]))
    write_road(tmp_path, [WIDE_ROAD])
    (tmp_path / VERSION / f"{table}.json").unlink()
    split = label_split(data)
    with caplog.at_level(logging.WARNING):
        values = DrivingChecks(split, data)(split.futures.xy_m)
    assert sorted(values) == [f"off_road_{horizon_s}s" for horizon_s in CHECK_HORIZONS_S]
    assert "No table of annotations" in caplog.text


def test_what_cannot_be_told_is_left_out(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    # As in nuScenes' test split: tables without a record, and no map expansion.
    with caplog.at_level(logging.WARNING):
        checks, split = _checks(tmp_path, [])
        assert checks(split.futures.xy_m) == {}
    assert "No annotation of these scenes" in caplog.text
    assert "No map expansion of boston-seaport" in caplog.text


def test_paths_of_another_shape_are_refused(tmp_path: Path) -> None:
    checks, split = _checks(tmp_path, [standing(12.0, 6.0)])
    with pytest.raises(ValueError, match=r"\(7, 20, 2\).*\(6, 20, 2\)"):
        checks(split.futures.xy_m[:-1])
