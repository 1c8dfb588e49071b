"""Where the poles and heads of traffic lights stand."""

import numpy as np
import shapely

from shoot.world.town.draft import Road
from shoot.world.town.network import Arm
from shoot.world.town.town import FloatArray, Signal


def place_lights(
    middle_m: FloatArray,
    arm: Arm,
    roads: tuple[Road, ...],
    poles_off: shapely.Geometry,
) -> Signal:
    """Two heads: one on the near right corner, one beyond the intersection over the lane.

    Args:
        middle_m: [2] middle of the intersection.
        arm: Whose cars they are for.
        roads: All of the town.
        poles_off: Where no pole may stand.
    """
    ahead = -arm.outward
    right = np.array([ahead[1], -ahead[0]])
    kind = roads[arm.road].plan.kind
    side_m = kind.half_m + 0.8
    more_m = np.arange(0.0, 8.0, 0.5)
    feet = []
    for ahead_m in (np.array([-arm.trim_m - 0.4]), np.arange(7.0, 24.0, 0.5)):
        sideways_m, forward_m = (g.ravel() for g in np.meshgrid(more_m, ahead_m, indexing="ij"))
        places_m = middle_m + np.outer(forward_m, ahead) + np.outer(sideways_m + side_m, right)
        is_clear = ~shapely.contains_xy(poles_off, *places_m.T)
        feet.append(places_m[int(np.argmax(is_clear))])
    over = middle_m + ahead * ((feet[1] - middle_m) @ ahead) + right * kind.lane_m * kind.lanes / 2
    heads = np.array([[*feet[0], 3.0], [*over, 5.2]])
    facing_rad = float(np.arctan2(arm.outward[1], arm.outward[0]))
    return Signal(heads, facing_rad, np.stack(feet), arm.axis)
