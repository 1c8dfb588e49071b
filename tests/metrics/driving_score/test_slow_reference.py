"""Contacts and near collisions a second way: polygon by polygon, step by step."""

import numpy as np
import shapely
from shapely import affinity
from straight_road import BUSY_STEPS as T
from straight_road import busy_scene

from shoot.metrics.driving_score.collisions import find_contacts
from shoot.metrics.driving_score.surroundings import locate
from shoot.metrics.driving_score.time_to_collision import near_collisions


def test_collisions_are_those_of_a_slow_reference() -> None:
    """Every pair of polygons, one by one; touching is as good as impossible here."""
    met = 0
    for seed in range(3):
        ego, others, around = busy_scene(seed)
        where = locate(ego, around)
        first, near = {}, set()
        for i in range(len(others)):
            before = None
            for step in range(T):
                hits = [
                    delay
                    for delay in (0, 3, 6, 9)
                    if abs(ego.speed_mps[step]) >= 0.005
                    and step + 9 < T
                    and ground(ego, step, delay).intersects(box(others, i, step + delay))
                ]
                is_hit = ground(ego, step, 0).intersects(box(others, i, step))
                if is_hit and i not in first:
                    first[i] = step
                if hits and not before and not (step == 0 and is_hit):
                    off_deg = angle_deg(ego, step, others.centre_m[i, step])
                    heeds = where.is_in_several_lanes[step] or where.off_road_m[step] > 0.0
                    heeds = heeds or where.is_axle_in_intersection[step]
                    if off_deg <= 30.0 or (heeds and off_deg < 150.0):
                        near.add(step)
                before = hits
        assert {c.other: c.step for c in find_contacts(ego, others, where)} == first
        assert set(np.flatnonzero(near_collisions(ego, others, where))) == near
        met += len(first) * len(near)
    assert met > 0


def box(others, i, step):
    length_m, width_m = others.size_m[i] / 2
    return placed(
        shapely.box(-length_m, -width_m, length_m, width_m),
        others.yaw_rad[i, step],
        others.centre_m[i, step],
    )


def ground(ego, step, delay):
    """The footprint, moved on by some steps."""
    way_m = ego.speed_mps[step] * delay * 0.1
    here = shapely.box(way_m - 1.0, -0.925, way_m + 3.1, 0.925)
    return placed(here, ego.yaw_rad[step], ego.xy_m[step])


def placed(polygon, yaw_rad, xy_m):
    turned = affinity.rotate(polygon, yaw_rad, origin=(0, 0), use_radians=True)
    return affinity.translate(turned, *xy_m)


def angle_deg(ego, step, point_m):
    way = np.array([np.cos(ego.yaw_rad[step]), np.sin(ego.yaw_rad[step])])
    away_m = point_m - ego.xy_m[step]
    return np.degrees(np.arccos(away_m @ way / np.linalg.norm(away_m)))
