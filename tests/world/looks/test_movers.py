"""Where everybody is between two steps of a recording."""

from dataclasses import replace

import numpy as np
import pytest
from street_scene import car, recording

from shoot.world.looks.movers import Movers
from shoot.world.looks.scenery import ego_pose


def test_poses_between_steps():
    tracks = replace(recording(ego_speed_mps=8.0), ego_yaw_rad=np.linspace(0.0, 1.0, 41))
    x, y, yaw = ego_pose(tracks, 1.025)
    assert (x, y, yaw) == pytest.approx((40.0 + 8 * 0.025, 50.0, 0.5125))
    # An agent that turns through +-pi takes the short way.
    turning = replace(car((0.0, 0.0), 0.0), yaw_rad=np.where(np.arange(41) < 21, 3.1, -3.1))
    moment = Movers(replace(tracks, agents=(turning,))).at(1.025)
    assert abs(moment.yaw_rad[0]) == pytest.approx(np.pi, abs=1e-6)
