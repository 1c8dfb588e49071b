"""What collision and off-road rates rest on: absent is said to be absent, and is never zero."""

import logging
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from driving_world import (
    NUM_SAMPLES,
    WIDE_ROAD,
    Thing,
    config_of,
    label_split,
    standing,
    write_drive,
    write_road,
)
from html_fixture import make_report, read_page
from tiny_tables import TRAIN_A, VAL, read_table, write_table

from lss_core.errors import DataError
from shoot.evaluation.check_basis import CheckBasis
from shoot.evaluation.driving_checks import DrivingChecks
from shoot.report.html import PageDetails, render_page
from shoot.report.terminal import format_table

THINGS = [standing(12.0, 6.0), Thing(lambda t: (30.0 + 3.0 * t, 4.0, 0.0), category="vehicle.bus")]


def _checks(root: Path) -> DrivingChecks:
    data = config_of(root)
    return DrivingChecks(label_split(data), data)


def _values(root: Path) -> dict[str, np.ndarray]:
    data = config_of(root)
    split = label_split(data)
    return DrivingChecks(split, data)(split.futures.xy_m)


def _change(root: Path, change: Callable[[list[dict[str, Any]]], list[dict[str, Any]]]) -> None:
    write_table(root, "sample_annotation", change(read_table(root, "sample_annotation")))


def _without_tracks(root: Path, scene: str = "") -> None:
    """Each box is an object of its own, as tools write that know no tracks."""
    instances = {row["token"]: row for row in read_table(root, "instance")}
    changed = []
    for row in read_table(root, "sample_annotation"):
        if row["sample_token"].startswith(scene):
            token = f"of-{row['token']}"
            instances[token] = instances[row["instance_token"]] | {"token": token}
            row |= {"instance_token": token}
        changed.append(row)
    write_table(root, "instance", instances.values())
    write_table(root, "sample_annotation", changed)


def test_a_whole_data_set_says_what_its_rates_rest_on(tmp_path: Path) -> None:
    write_drive(tmp_path, THINGS)
    write_road(tmp_path, [WIDE_ROAD])
    basis = _checks(tmp_path).basis
    assert basis == CheckBasis(
        num_samples=NUM_SAMPLES,
        num_samples_with_boxes=NUM_SAMPLES,
        num_samples_on_road=NUM_SAMPLES,
        num_samples_with_map=NUM_SAMPLES,
        boxes={"vehicle.car": 1, "vehicle.bus": 1},
    )
    collisions, off_road = basis.sentences()
    assert "2 objects (vehicle.bus 1, vehicle.car 1), at 7 of 7 samples" in collisions
    assert "maps at 7 of 7 samples" in off_road


def test_unknown_categories_are_no_rate_of_zero(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    things = [replace(thing, category=name) for thing, name in zip(THINGS, "ab", strict=True)]
    write_drive(tmp_path, things)
    with caplog.at_level(logging.WARNING):
        assert not any(key.startswith("collision") for key in _values(tmp_path))
    assert "No boxes of known categories (a, b): collisions are left out" in caplog.text
    basis = _checks(tmp_path).basis
    assert basis.sentences()[0] == "collisions: no boxes of known categories (a, b), left out"
    assert basis.unknown == {"a": 17, "b": 17}


def test_some_unknown_categories_are_counted(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    write_drive(tmp_path, [THINGS[0], replace(THINGS[1], category="rickshaw")])
    with caplog.at_level(logging.WARNING):
        assert (_values(tmp_path)["collision_1s"] == 0.0).all()
    assert "17 annotations are of categories that nobody here knows" in caplog.text
    assert "rickshaw (17)" in caplog.text


def test_boxes_without_tracks_are_no_rate(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    write_drive(tmp_path, THINGS)
    assert "collision_1s" in _values(tmp_path)
    _without_tracks(tmp_path)
    with caplog.at_level(logging.WARNING):
        assert not any(key.startswith("collision") for key in _values(tmp_path))
    assert "Boxes without tracks" in caplog.text
    assert "without tracks" in _checks(tmp_path).basis.sentences()[0]


def test_a_scene_without_tracks_beside_others_is_not_known(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    scenes = (VAL, replace(TRAIN_A, name="scene-0012"))
    write_drive(tmp_path, THINGS, scenes)
    _change(
        tmp_path,
        lambda rows: rows
        + [
            row | {
                "token": f"b{row['token']}",
                "sample_token": row["sample_token"].replace(VAL.name, "scene-0012"),
            }
            for row in rows
        ],
    )  # fmt: skip
    _without_tracks(tmp_path, "scene-0012")
    data = config_of(tmp_path)
    split = label_split(data)
    with caplog.at_level(logging.WARNING):
        checks = DrivingChecks(split, data)
    values = checks(split.futures.xy_m)["collision_1s"]
    assert np.isfinite(values).tolist() == (split.scene_names == VAL.name).tolist()
    assert "1 of 2 scenes have boxes without tracks" in caplog.text
    assert checks.basis.boxes == {"vehicle.car": 1, "vehicle.bus": 1}
    assert checks.basis.num_samples_with_boxes == NUM_SAMPLES


def test_objects_that_are_seen_once_may_be_meant(tmp_path: Path) -> None:
    # One here, one there, and others with tracks: as at the edge of what annotators see.
    once = [replace(THINGS[0], keyframes=[number]) for number in (2, 3, 9)]
    write_drive(tmp_path, [*THINGS, *once, replace(THINGS[1], keyframes=range(4, 8))])
    assert not _checks(tmp_path).basis.no_collisions
    write_drive(tmp_path / "few", [replace(THINGS[0], keyframes=[2])])
    assert not _checks(tmp_path / "few").basis.no_collisions


def test_an_object_twice_in_a_sample_is_refused(tmp_path: Path) -> None:
    write_drive(tmp_path, THINGS)
    _change(tmp_path, lambda rows: [*rows, rows[3] | {"token": "again"}])
    token = read_table(tmp_path, "sample_annotation")[3]["token"]
    with pytest.raises(DataError, match=f"'{token}' and 'again'.*of one instance") as caught:
        _checks(tmp_path)
    assert "\n" not in str(caught.value)


def test_two_objects_in_one_place_are_warned_of(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    write_drive(tmp_path, [THINGS[0], THINGS[0], THINGS[1]])
    with caplog.at_level(logging.WARNING):
        assert (_values(tmp_path)["collision_1s"] == 0.0).all()
    assert "17 boxes lie in the very place of another one" in caplog.text


def test_a_map_without_road_is_no_rate(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    write_drive(tmp_path, THINGS)
    write_road(tmp_path, [])
    with caplog.at_level(logging.WARNING):
        assert not any(key.startswith("off_road") for key in _values(tmp_path))
    assert "No drivable area in the maps of boston-seaport" in caplog.text


def test_a_map_of_another_place_is_warned_of(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    write_drive(tmp_path, THINGS)
    write_road(tmp_path, [[[(500.0, 0.0), (501.0, 0.0), (500.0, 1.0)], []]])
    with caplog.at_level(logging.WARNING):
        assert (_values(tmp_path)["off_road_1s"] == 100.0).all()
    assert "drivable area at 0 of 7 samples only" in caplog.text


def test_reports_show_a_dash_and_why() -> None:
    keys = tuple(make_report().overall.methods["model"])
    there = tuple(key for key in keys if not key.startswith("collision"))
    why = "no boxes of known categories (a)"
    basis = CheckBasis(12, no_collisions=why, num_samples_with_map=12)
    report = replace(make_report(keys=there), rests_on=basis)
    said = "collisions: no boxes of known categories (a), left out"
    text = format_table(report)
    assert said in " ".join(text.split())
    heading = next(line for line in text.splitlines() if "crash" in line)
    column = heading.index("crash")
    rows = [line for line in text.splitlines() if line.startswith((" model", "model"))]
    assert any(line[column : column + 5].strip() == "-" for line in rows)
    page = render_page(report, {}, PageDetails("run", "data", "date"))
    assert said in read_page(page).text
    assert report.to_json()["rests_on"]["no_collisions"] == "no boxes of known categories (a)"
    assert report.to_json()["rests_on"]["no_off_road"] is None
