"""Pictures beside results: strips always, videos if asked for, also afterwards."""

from dataclasses import replace
from pathlib import Path

import pytest

from shoot.report.driving.page import write_driving_page
from shoot.simulation.drivers.making import DriverSettings
from shoot.simulation.routes.result_files import route_file, strip_file, video_file
from shoot.simulation.routes.running import RouteSettings, run_routes
from shoot.simulation.routes.summary import sum_up
from shoot.simulation.senses import SensorSettings

SETTINGS = RouteSettings(DriverSettings("still"), SensorSettings(), "replay", 1, 2.5)


def test_a_route_leaves_a_strip_and_a_video_when_asked_for(tmp_path: Path) -> None:
    pytest.importorskip("av")
    rows = run_routes(SETTINGS, 1, tmp_path)
    result, strip = (file(tmp_path, 0).read_bytes() for file in (route_file, strip_file))
    assert strip.startswith(b"\xff\xd8")
    assert not video_file(tmp_path, 0).exists()
    assert all({"time_s", "what", "at_m"} == set(one) for one in rows[0]["mishaps"])

    page = write_driving_page(tmp_path, sum_up(rows, SETTINGS.card()).to_json(), rows)
    assert page.read_text(encoding="utf-8").count("data:image/jpeg") == 1

    assert run_routes(SETTINGS, 1, tmp_path, with_video=True) == rows
    assert video_file(tmp_path, 0).stat().st_size > 10_000
    assert route_file(tmp_path, 0).read_bytes() == result
    assert strip_file(tmp_path, 0).read_bytes() == strip
    written = video_file(tmp_path, 0).stat().st_mtime_ns
    run_routes(SETTINGS, 1, tmp_path, with_video=True)
    assert video_file(tmp_path, 0).stat().st_mtime_ns == written


def test_a_route_that_failed_has_no_pictures_and_is_not_tried_again(tmp_path: Path) -> None:
    pytest.importorskip("av")
    too_short = replace(SETTINGS, duration_s=2.0)
    (row,) = run_routes(too_short, 1, tmp_path, with_video=True)
    assert row["error"] is not None
    assert not strip_file(tmp_path, 0).exists()
    assert not video_file(tmp_path, 0).exists()
    before = route_file(tmp_path, 0).stat().st_mtime_ns
    run_routes(too_short, 1, tmp_path, with_video=True)
    assert route_file(tmp_path, 0).stat().st_mtime_ns == before
