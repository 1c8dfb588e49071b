"""A car that came a little too far before people on a crosswalk stops all the same."""

import numpy as np
from world_fixture import result_beside

from shoot.world.town.roads import make_town
from shoot.world.traffic.bodies import EgoBody
from shoot.world.traffic.live import stage

# People cross before this ego from 14 s on; by the rules it stands at a line 1 m before them.
TOWN, SEED, DURATION_S = 1564231217, 445064791, 20.0
STANDS_AT_S = 14.9


def stops() -> tuple[np.ndarray, float]:
    """(how far the ego drives in 2.5 s when it begins 10 cm too far at walking pace, its pace)."""
    live = stage(make_town(TOWN), SEED, DURATION_S, "replay")
    while live.time_s < STANDS_AT_S:
        live.step(None)
    assert live.ego.speed_mps < 0.05
    ahead = np.array([np.cos(live.ego.yaw_rad), np.sin(live.ego.yaw_rad)])
    live.step(EgoBody(live.ego.xy_m + 0.1 * ahead, live.ego.yaw_rad, 0.8))
    xy_m, _, speed_mps = live.foresee(2.5)
    return (xy_m - live.ego.xy_m) @ ahead, float(speed_mps[-1])


def test_it_stops_before_them() -> None:
    driven_m, speed_mps = result_beside(stops)
    assert driven_m.max() < 0.9
    assert speed_mps < 0.1
