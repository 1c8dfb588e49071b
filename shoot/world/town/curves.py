"""Plane curves as [P, 2] points: rounded polygons, parallels, turns across an intersection."""

import numpy as np

from shoot.world.town.town import FloatArray


def arc_lengths(points_m: FloatArray) -> FloatArray:
    """[P] distance travelled along [P, 2] points, from 0."""
    steps = np.hypot(*np.diff(points_m, axis=0).T)
    return np.concatenate([[0.0], np.cumsum(steps)])


def resample(points_m: FloatArray, step_m: float) -> FloatArray:
    """[Q, 2] evenly spaced points of the same curve, at most `step_m` apart, both ends kept."""
    s_m = arc_lengths(points_m)
    num = max(2, int(np.ceil(s_m[-1] / step_m - 1e-9)) + 1)
    at_m = np.linspace(0.0, s_m[-1], num)
    return np.stack([np.interp(at_m, s_m, points_m[:, i]) for i in (0, 1)], axis=1)


def cut(points_m: FloatArray, start_m: float, end_m: float) -> FloatArray:
    """[Q, 2] the part of the curve between two arc lengths."""
    s_m = arc_lengths(points_m)
    inner = (s_m > start_m + 1e-6) & (s_m < end_m - 1e-6)
    at_m = np.concatenate([[start_m], s_m[inner], [end_m]])
    return np.stack([np.interp(at_m, s_m, points_m[:, i]) for i in (0, 1)], axis=1)


def point_at(points_m: FloatArray, at_m: float) -> tuple[FloatArray, FloatArray]:
    """([2] point, [2] unit tangent) at one arc length."""
    s_m = arc_lengths(points_m)
    i = int(np.clip(np.searchsorted(s_m, at_m, side="right") - 1, 0, len(s_m) - 2))
    tangent = (points_m[i + 1] - points_m[i]) / (s_m[i + 1] - s_m[i])
    return points_m[i] + tangent * (at_m - s_m[i]), tangent


def normals(points_m: FloatArray) -> FloatArray:
    """[P, 2] unit vectors to the left of the direction of travel."""
    tangents = np.gradient(points_m, arc_lengths(points_m), axis=0)
    tangents /= np.hypot(*tangents.T)[:, None]
    return np.stack([-tangents[:, 1], tangents[:, 0]], axis=1)


def parallel(points_m: FloatArray, left_m: float) -> FloatArray:
    """[P, 2] the same curve `left_m` to its left (negative: right)."""
    return points_m + left_m * normals(points_m)


def round_corners(
    polygon_m: FloatArray,
    radii_m: FloatArray,
    keep_m: tuple[float, float] = (0.0, 0.0),
    step_m: float = 0.25,
) -> FloatArray:
    """[Q, 2] the open polygon with an arc in place of each inner corner.

    Args:
        polygon_m: [P, 2] corners.
        radii_m: [P - 2] wished radius of each inner corner; smaller where the sides are too short.
        keep_m: How much of the first and of the last side stays straight.
        step_m: Greatest distance between points on an arc.
    """
    sides = np.diff(polygon_m, axis=0)
    lengths_m = np.hypot(*sides.T)
    directions = sides / lengths_m[:, None]
    room_m = lengths_m / 2
    room_m[0], room_m[-1] = lengths_m[0] - keep_m[0], lengths_m[-1] - keep_m[1]
    pieces = [polygon_m[:1]]
    for i in range(1, len(polygon_m) - 1):
        before, after = directions[i - 1], directions[i]
        turn_rad = np.arctan2(before[0] * after[1] - before[1] * after[0], before @ after)
        if abs(turn_rad) < 1e-3:
            continue
        slope = np.tan(abs(turn_rad) / 2)
        cut_m = min(radii_m[i - 1] * slope, room_m[i - 1], room_m[i])
        radius_m = cut_m / slope
        start = polygon_m[i] - before * cut_m
        inward = np.sign(turn_rad) * np.array([-before[1], before[0]])
        centre = start + inward * radius_m
        num = max(3, int(np.ceil(radius_m * abs(turn_rad) / step_m)) + 1)
        angles = np.linspace(0.0, turn_rad, num)
        spoke = -inward * radius_m
        cos, sin = np.cos(angles), np.sin(angles)
        arc = np.stack([cos * spoke[0] - sin * spoke[1], sin * spoke[0] + cos * spoke[1]], axis=1)
        pieces.append(centre + arc)
    pieces.append(polygon_m[-1:])
    joined = np.concatenate(pieces)
    distinct = np.concatenate([[True], np.hypot(*np.diff(joined, axis=0).T) > 1e-9])
    return np.asarray(joined[distinct])


def turn_between(
    start_m: FloatArray, start_dir: FloatArray, end_m: FloatArray, end_dir: FloatArray
) -> FloatArray:
    """[Q, 2] smooth path from one pose to another, as a car would cross an intersection.

    A straight and an arc where the two lines meet ahead at a fair angle, else a cubic.

    Args:
        start_m: [2] first point.
        start_dir: [2] unit direction there.
        end_m: [2] last point.
        end_dir: [2] unit direction there.
    """
    chord = end_m - start_m
    cross = start_dir[0] * end_dir[1] - start_dir[1] * end_dir[0]
    if abs(cross) > 0.45:
        ahead_m = (chord[0] * end_dir[1] - chord[1] * end_dir[0]) / cross
        behind_m = (start_dir[0] * chord[1] - start_dir[1] * chord[0]) / cross
        if ahead_m > 1.0 and behind_m > 1.0:
            corner = start_m + ahead_m * start_dir
            return round_corners(np.stack([start_m, corner, end_m]), np.array([1e3]))
    reach_m = 0.39 * np.hypot(*chord)
    t = np.linspace(0.0, 1.0, 64)[:, None]
    return np.asarray(
        (1 - t) ** 3 * start_m
        + 3 * (1 - t) ** 2 * t * (start_m + reach_m * start_dir)
        + 3 * (1 - t) * t**2 * (end_m - reach_m * end_dir)
        + t**3 * end_m
    )
