"""What went wrong is told once, when it begins, in the words that fit."""

from dataclasses import replace

import numpy as np
import shapely
from straight_road import FRONT_M, MIDDLE_M, at_speed, drive, other, road, together

from shoot.metrics.driving_score import Others, Surroundings, Track, no_others
from shoot.simulation.filming.mishaps import find_mishaps

STEPS = 41


def told(
    ego: Track, others: Others | None = None, around: Surroundings | None = None, name: str = "car"
) -> list[tuple[float, str]]:
    others = no_others(len(ego)) if others is None else others
    around = road() if around is None else around
    lanes = replace(around.lanes, is_on_route=np.ones(2, bool))
    lawful = replace(around, lanes=lanes)
    names = (name,) * len(others)
    found = find_mishaps(ego, others, names, lawful, around, start_s=2.0)
    return [(mishap.time_s, mishap.words) for mishap in found]


def test_nothing_is_told_of_a_drive_without_faults() -> None:
    assert told(at_speed(5.0)) == []


def test_a_hit_is_told_with_whom_and_who_is_to_blame() -> None:
    ego = at_speed(10.0)
    # The bumper, 1 m a step, is beyond 30 m at the step after the one at which it gets there.
    step = int(np.ceil(30.0 - FRONT_M - 10.0))
    ahead = other(np.full(STEPS, 32.0))
    assert told(ego, ahead, name="parked car") == [
        (2.0 + 0.1 * step, "hits a parked car that stands, at fault")
    ]
    thing = other(np.full(STEPS, 32.0), kind="object")
    assert told(ego, thing, name="building")[0][1] == "hits a building, at fault"
    standing = drive(np.full(STEPS, 50.0))
    behind = other(30.0 + 10.0 * 0.1 * np.arange(STEPS), speed_mps=10.0)
    words = [words for _, words in told(standing, behind, name="truck")]
    assert "is touched by a truck while standing, not at fault" in words


def test_all_hits_are_told_in_the_order_of_time() -> None:
    far, near = other(np.full(STEPS, 42.0), kind="object"), other(np.full(STEPS, 27.0))
    times_s = [time_s for time_s, words in told(at_speed(10.0), together(far, near))
               if words.startswith("hits")]  # fmt: skip
    assert len(times_s) == 2
    assert times_s == sorted(times_s)


def test_the_road_is_left_once_unless_for_long() -> None:
    """Lane and road end at y = -2, the right flank lies 0.925 m to the right."""
    y_m = np.zeros(61)
    y_m[10:20] = y_m[24:30] = y_m[45:50] = -1.5
    # 0.5 s between the first two, 1.6 s before the third.
    ego = drive(10.0 + 0.5 * np.arange(61), y_m)
    assert told(ego) == [(3.0, "leaves the road"), (6.5, "leaves the road")]


def test_a_red_light_is_told_when_the_bumper_passes() -> None:
    red = np.ones(STEPS, bool)
    around = road(junction=(30.0, 50.0), red=red)
    step = int(np.ceil(30.0 - FRONT_M - 10.0))
    assert told(at_speed(10.0), around=around) == [(round(2.0 + 0.1 * step, 6), "runs a red light")]


def test_oncoming_lanes_are_told_of_after_two_metres() -> None:
    """The oncoming lane is none of the route's either; it is told as the worse of both."""
    assert told(at_speed(5.0, y_m=4.0)) == [(2.4, "drives in no lane of its direction")]
    back = drive(100.0 - 0.5 * np.arange(STEPS), 4.0, np.pi, speed_mps=5.0)
    assert told(back) == [(2.4, "strays from its route")]


def test_standing_is_told_after_two_seconds_if_nothing_shows_why() -> None:
    ego = drive(np.full(STEPS, 50.0))
    assert told(ego) == [(4.0, "stands, and nothing shows why")]
    ahead = other(np.full(STEPS, 50.0 + MIDDLE_M + 8.0))
    assert told(ego, ahead) == []
    around = replace(road(), drivable=shapely.box(0.0, -2.0, 300.0, 6.0))
    assert told(drive(np.full(20, 50.0)), around=around) == []


def test_places_are_those_of_the_middle() -> None:
    y_m = np.zeros(STEPS)
    y_m[10:] = -1.5
    ego = drive(10.0 + 0.5 * np.arange(STEPS), y_m)
    (mishap,) = find_mishaps(ego, no_others(STEPS), (), road(), road())
    np.testing.assert_allclose(mishap.xy_m, [15.0 + MIDDLE_M, -1.5])
    assert mishap.time_s == 1.0
