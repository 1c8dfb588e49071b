"""The route as a gate: templates that leave its lanes are masked, the network never knows of it.

A planner that sees only images turns at random at intersections. Where it is to go is told by
masking: what of its own distribution stays on the route is renormalised.
"""

from typing import Any

import numpy as np
import shapely
from jaxtyping import Bool, Float
from scipy.special import logsumexp

from shoot.footprint import turn
from shoot.simulation.route_lanes import ground_of, lanes_of_route
from shoot.simulation.vehicle import VehicleState
from shoot.world.town.town import Town
from shoot.world.traffic.driver import Route

Array = np.ndarray[Any, np.dtype[Any]]

# Further behind and ahead the route may cross its own way. 5 s at the fastest speed are 70 m.
BEHIND_M, AHEAD_M = 10.0, 85.0


def on_route(
    templates: Float[Array, "K T 2"],
    state: VehicleState,
    town: Town,
    route: Route,
    at_m: float,
) -> Bool[Array, " K"]:
    """Whether all points of a template lie on lanes of the route just ahead.

    Beside the route's own lanes and paths their neighbours in the same direction count, and the
    paths that join them.

    Args:
        templates: Points in metres in `ego`.
        state: Of the ego.
        town: Where.
        route: Its way.
        at_m: How far along it the ego is.
    """
    area = ground_of(town, _lanes_ahead(town, route, at_m))
    shapely.prepare(area)
    points_m = turn(templates.astype(np.float64), np.asarray(state.yaw_rad))
    points_m = points_m + np.array([state.x_m, state.y_m])
    inside = shapely.contains_xy(area, points_m[..., 0], points_m[..., 1])
    all_inside: Array = np.all(inside, axis=-1)
    return all_inside


def pass_gate(
    log_prob: Float[Array, " K"], is_on_route: Bool[Array, " K"]
) -> Float[Array, " K"] | None:
    """The distribution over the templates on the route, -inf for the others.

    None if it leaves nothing: nothing that it holds possible stays on the route.

    Args:
        log_prob: In nats.
        is_on_route: See `on_route`.
    """
    kept = np.where(is_on_route, log_prob, -np.inf)
    if not np.isfinite(kept).any():
        return None
    renormalised: Array = kept - logsumexp(kept)
    return renormalised


def _lanes_ahead(town: Town, route: Route, at_m: float) -> set[int]:
    """Lanes and paths of the route near the ego, with neighbours."""
    starts_m = np.array(route.starts_m)
    is_near = (starts_m[1:] > at_m - BEHIND_M) & (starts_m[:-1] < at_m + AHEAD_M)
    return lanes_of_route(town, route.lanes, np.flatnonzero(is_near).tolist())
