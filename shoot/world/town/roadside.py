"""What stands beside the roads: parked cars, houses, trees, lamp posts and smaller things."""

from collections.abc import Sequence

import numpy as np
import shapely

from shoot.world.town.curves import arc_lengths, cut, normals, parallel, point_at, resample
from shoot.world.town.network import NARROW, RoadKind
from shoot.world.town.town import Building, Crosswalk, FloatArray, ParkedCar, Prop, Signal

Road = tuple[FloatArray, RoadKind]
PARKING_SHARE = {"narrow": 0.75, "normal": 0.3, "wide": 0.0}
# No parking near a stop line: the mouth, the crosswalk and 12 m more.
NO_PARKING_M = 17.0
# How far from the kerb things keep.
ROAD_ROOM_M = {"lamp_post": 0.35, "bin": 0.4, "tree": 1.0, "bush": 3.0}


def park_cars(
    roads: Sequence[Road],
    crosswalks: Sequence[Crosswalk],
    strip_m: float,
    rng: np.random.Generator,
) -> tuple[list[shapely.Geometry], tuple[ParkedCar, ...]]:
    """Parking strips along some kerbs and the cars in them.

    Args:
        roads: Middle lines [P, 2] between intersections, and kinds.
        crosswalks: Kept clear.
        strip_m: Width of a strip.
        rng: Source of chance.

    Returns:
        The strips, and the cars.
    """
    strips: list[shapely.Geometry] = []
    cars: list[ParkedCar] = []
    clear = shapely.union_all([shapely.Polygon(c.outline_m) for c in crosswalks]).buffer(6.0)
    for middle_m, kind in roads:
        for side in (-1.0, 1.0):
            wanted = rng.random() < PARKING_SHARE[kind.name]
            fill = rng.uniform(0.4, 0.9)
            length_m = arc_lengths(middle_m)[-1]
            if not wanted or length_m < 2 * NO_PARKING_M + 8.0:
                continue
            inner = cut(middle_m, NO_PARKING_M, length_m - NO_PARKING_M)
            line = parallel(resample(inner, 1.0), side * (kind.half_m + strip_m / 2))
            strip = shapely.LineString(line).buffer(strip_m / 2 + 0.02, cap_style="flat")
            strips += [
                g for g in shapely.get_parts(strip.difference(clear)) if g.area > 5.0 * strip_m
            ]
            s_m, end_m = 3.0, arc_lengths(line)[-1] - 3.0
            while s_m < end_m:
                size_m = np.array(
                    [rng.uniform(3.9, 4.8), rng.uniform(1.7, 1.9), rng.uniform(1.4, 1.75)]
                )
                at, along = point_at(line, s_m)
                is_taken = rng.random() < fill
                style = int(rng.integers(1 << 16))
                tilt_rad = float(rng.normal(0.0, 0.015))
                # Right-hand traffic: cars on the left kerb of the middle line look backwards.
                yaw_rad = float(np.arctan2(along[1], along[0])) + (np.pi if side > 0 else 0.0)
                if is_taken and not shapely.dwithin(clear, shapely.Point(at), 3.0):
                    cars.append(ParkedCar(at, yaw_rad + tilt_rad, size_m, style))
                s_m += rng.uniform(5.6, 6.6)
    return strips, tuple(cars)


def furnish(
    size_m: float,
    road: shapely.Geometry,
    pavement: shapely.Geometry,
    roads: Sequence[Road],
    signals: Sequence[Signal],
    rng: np.random.Generator,
) -> tuple[tuple[Building, ...], tuple[Prop, ...]]:
    """Houses along all roads, trees, lamp posts, bins and bushes.

    Args:
        size_m: Side of the town; nothing stands beyond it.
        road: Carriageway.
        pavement: Walkways.
        roads: Middle lines [P, 2] between intersections, and kinds.
        signals: Their poles are kept clear.
        rng: Source of chance.
    """
    taken = shapely.union(road, pavement).buffer(0.3)
    buildings = _build_houses(size_m, taken, roads, rng)
    houses = shapely.union_all([shapely.Polygon(b.outline_m) for b in buildings])
    poles = np.concatenate([s.pole_feet_m for s in signals]) if signals else np.zeros((0, 2))
    props = _plant(size_m, road, houses, roads, poles, rng)
    return buildings, props


def _build_houses(
    size_m: float, taken: shapely.Geometry, roads: Sequence[Road], rng: np.random.Generator
) -> tuple[Building, ...]:
    shapely.prepare(taken)
    buildings: list[Building] = []
    shapes = np.empty(2000, dtype=object)
    for middle_m, kind in roads:
        for side in (-1.0, 1.0):
            # On the inner side of a bend houses would overlap; those are dropped.
            length_m = arc_lengths(middle_m)[-1]
            setback_m = kind.half_m + 3.3 + rng.uniform(0.3, 4.0)
            height_m = rng.uniform(5.0, 16.0)
            s_m = rng.uniform(-14.0, -6.0)
            while s_m < length_m + 8.0:
                front_m, depth_m = rng.uniform(9.0, 20.0), rng.uniform(9.0, 16.0)
                at, along = point_at(middle_m, float(np.clip(s_m + front_m / 2, 0.1, length_m)))
                at = at + along * (s_m + front_m / 2 - np.clip(s_m + front_m / 2, 0.1, length_m))
                left = side * np.array([-along[1], along[0]])
                extra_m = rng.choice([0.0, 2.2])
                base = at + left * (setback_m + extra_m)
                half = along * front_m / 2
                outline = np.stack(
                    [base - half, base + half,
                     base + half + left * depth_m, base - half + left * depth_m]
                )  # fmt: skip
                if side < 0:
                    outline = outline[::-1]
                tall_m = float(np.clip(height_m * rng.uniform(0.6, 1.5), 4.0, 26.0))
                style, gap_m = int(rng.integers(1 << 16)), rng.choice([0.3, 0.3, 2.0, 6.0])
                shape = shapely.Polygon(outline)
                inside = outline.min() > 1.0 and outline.max() < size_m - 1.0
                if (
                    inside
                    and not shapely.intersects(taken, shape)
                    and not shapely.intersects(shapes[: len(buildings)], shape).any()
                ):
                    shapes[len(buildings)] = shape
                    buildings.append(Building(outline, tall_m, style))
                    s_m += front_m + gap_m
                else:
                    s_m += 4.0
    return tuple(buildings)


def _plant(
    size_m: float,
    road: shapely.Geometry,
    houses: shapely.Geometry,
    roads: Sequence[Road],
    poles_m: FloatArray,
    rng: np.random.Generator,
) -> tuple[Prop, ...]:
    props: list[Prop] = []

    off_road: dict[float, shapely.Geometry] = {}
    for room_m in ROAD_ROOM_M.values():
        off_road[room_m] = shapely.buffer(road, room_m, quad_segs=4)
        shapely.prepare(off_road[room_m])
    off_houses = {
        is_big: shapely.buffer(houses, 0.8 if is_big else 0.2) for is_big in (False, True)
    }
    for area in off_houses.values():
        shapely.prepare(area)
    spots = np.zeros((0, 3))

    def stand(kind: str, at: FloatArray, height_m: float, radius_m: float) -> None:
        nonlocal spots
        style = int(rng.integers(1 << 16))
        if not (at.min() > 0 and at.max() < size_m):
            return
        if shapely.contains_xy(off_road[ROAD_ROOM_M[kind]], *at):
            return
        if shapely.contains_xy(off_houses[radius_m > 0.5], *at):
            return
        if len(poles_m) and np.hypot(*(poles_m - at).T).min() < 1.2 + radius_m:
            return
        if np.any(np.hypot(*(spots[:, :2] - at).T) < 0.8 * (spots[:, 2] + radius_m)):
            return
        spots = np.concatenate([spots, [[*at, radius_m]]])
        props.append(Prop(kind, at, height_m, radius_m, style))  # type: ignore[arg-type]

    for middle_m, kind in roads:
        length_m = arc_lengths(middle_m)[-1]
        sideways = normals(middle_m)
        s_of = arc_lengths(middle_m)
        is_lined = rng.random() < 0.6
        spacing_m = rng.uniform(8.0, 14.0)
        offset_m = kind.half_m + 0.7 + (2.2 if kind.name == NARROW.name else 0.0)
        for side in (-1.0, 1.0):
            for s_m in np.arange(6.0 if side < 0 else 18.0, length_m, 26.0):
                i = int(np.argmin(np.abs(s_of - s_m)))
                at = middle_m[i] + side * sideways[i] * offset_m
                stand("lamp_post", at, 6.5, 0.1)
            for s_m in np.arange(9.0, length_m - 6.0, spacing_m if is_lined else 31.0):
                i = int(np.argmin(np.abs(s_of - s_m - rng.uniform(-1.5, 1.5))))
                height_m = rng.uniform(4.5, 8.0)
                back_m = 1.2 if is_lined else rng.uniform(3.5, 7.0)
                at = middle_m[i] + side * sideways[i] * (offset_m + back_m)
                stand("tree", at, height_m, float(rng.uniform(1.2, 2.0)))
            for _ in range(int(rng.integers(0, 4))):
                i = int(rng.integers(len(middle_m)))
                at = middle_m[i] + side * sideways[i] * (offset_m + rng.uniform(0.1, 0.5))
                stand("bin", at, 1.0, 0.3)
            for _ in range(int(rng.integers(0, 5))):
                i = int(rng.integers(len(middle_m)))
                at = middle_m[i] + side * sideways[i] * (offset_m + rng.uniform(2.6, 6.0))
                stand("bush", at, float(rng.uniform(0.6, 1.3)), float(rng.uniform(0.5, 1.0)))
    for _ in range(160):
        at = rng.uniform(0.0, size_m, size=2)
        stand("tree", at, float(rng.uniform(5.0, 9.0)), float(rng.uniform(1.4, 2.4)))
    return tuple(props)
