"""How far along its route the ego is, also beside it and where the route comes by again."""

import numpy as np

from lss_core.geometry import wrap_angle
from shoot.simulation.vehicle import VehicleState
from shoot.world.traffic.driver import ROUTE_STEP_M, Route

_METRES_PER_RAD = 10.0
# Between two looks nobody drives further; further on it is the route of another time.
_BACK_M, _AHEAD_M = 10.0, 20.0


def next_place(route: Route, state: VehicleState, near_m: float) -> float:
    """Arc length in metres of the route's point nearest to the ego, near where it was last.

    A heading off the route's by a radian counts as being 10 m away.

    Args:
        route: Its way.
        state: Where it is.
        near_m: What the last look said.
    """
    at_m = np.arange(len(route.xy_m)) * ROUTE_STEP_M
    is_near = (at_m >= near_m - _BACK_M) & (at_m <= near_m + _AHEAD_M)
    away = np.hypot(route.xy_m[:, 0] - state.x_m, route.xy_m[:, 1] - state.y_m)
    away = away + _METRES_PER_RAD * np.abs(wrap_angle(route.yaw_rad - state.yaw_rad))
    return float(at_m[np.argmin(np.where(is_near, away, np.inf))])
