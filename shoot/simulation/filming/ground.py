"""What stands still around a drive, from above: drawn once for all its frames."""

from dataclasses import dataclass

import cv2
import numpy as np
import shapely

from lss_core.geometry import FloatArray, direction_of
from shoot.footprint import turn
from shoot.simulation.filming import colours
from shoot.simulation.filming.canvas import Canvas, Points, Rgb, colour, rings_of
from shoot.world.town.town import Town

PX_PER_M = 8.0
# Further from the way nothing is drawn.
MARGIN_M = 75.0
_EDGE_M = {"edge": 0.15, "lane": 0.15, "centre": 0.15, "stop": 0.4}
_CROSSWALK_STRIPE_M = 0.6
_PROPS = {"tree": colours.TREE, "bush": colours.TREE}


@dataclass(frozen=True, eq=False)
class Ground:
    """A piece of a town from above, north up.

    Attributes:
        rgb: [H, W, 3].
        pixel_from_town: [3, 3] where in it a place is (x, y, 1).
    """

    rgb: Rgb
    pixel_from_town: FloatArray

    def seen(self, view_from_town: FloatArray, width_px: int, height_px: int) -> Rgb:
        """[height, width, 3] the same from another place.

        Args:
            view_from_town: [3, 3] pixels there of places in the town.
            width_px: Of that view.
            height_px: Of that view.
        """
        view_from_pixel = view_from_town @ np.linalg.inv(self.pixel_from_town)
        seen: Rgb = cv2.warpAffine(
            self.rgb,
            view_from_pixel[:2],
            (width_px, height_px),
            flags=cv2.INTER_LINEAR,
            borderValue=colour(colours.LAWN),
        )
        return seen


def place(pixel_from_town: FloatArray, xy_m: Points) -> Points:
    """[..., 2] pixels of places [..., 2]."""
    placed: Points = xy_m @ pixel_from_town[:2, :2].T + pixel_from_town[:2, 2]
    return placed


def draw_ground(
    town: Town,
    way_m: FloatArray,
    route_lanes: tuple[int, ...],
    margin_m: float = MARGIN_M,
    px_per_m: float = PX_PER_M,
) -> Ground:
    """The town around a way, with the lanes of a route in green.

    Args:
        town: Where.
        way_m: [T, 2] what must be in the picture, with `margin_m` around it.
        route_lanes: Indices into `Town.lanes`.
        margin_m: See there.
        px_per_m: Scale.
    """
    low_m, high_m = way_m.min(axis=0) - margin_m, way_m.max(axis=0) + margin_m
    width_px, height_px = (int(np.ceil(side)) for side in (high_m - low_m) * px_per_m)
    pixel_from_town = np.array(
        [
            [px_per_m, 0.0, -low_m[0] * px_per_m - 0.5],
            [0.0, -px_per_m, high_m[1] * px_per_m - 0.5],
            [0.0, 0.0, 1.0],
        ]
    )
    canvas = Canvas.blank(width_px, height_px, colours.LAWN)
    window = shapely.box(*low_m, *high_m)

    def fill(geometry: shapely.Geometry, fill: str, opacity: float = 1.0) -> None:
        cut = shapely.intersection(geometry, window)
        rings = [place(pixel_from_town, ring) for ring in rings_of(cut)]
        canvas.fill(rings, fill, opacity)

    fill(town.pavement, colours.PAVEMENT)
    fill(town.road, colours.ROAD)
    lanes = [town.lanes[i] for i in dict.fromkeys(route_lanes)]
    route = [
        shapely.buffer(shapely.LineString(lane.centreline_m), lane.width_m / 2, cap_style="flat")
        for lane in lanes
    ]
    fill(shapely.intersection(shapely.union_all(route), town.road), colours.ROUTE, 0.22)
    for crosswalk in town.crosswalks:
        fill(_stripes(crosswalk.outline_m, crosswalk.path_m), colours.CROSSWALK)
    for line in town.lines:
        paint = colours.CENTRE_PAINT if line.kind == "centre" else colours.PAINT
        width_px = max(1, round(_EDGE_M[line.kind] * px_per_m))
        canvas.line(place(pixel_from_town, line.points_m), paint, width_px)
    for building in town.buildings:
        fill(shapely.Polygon(building.outline_m), colours.HOUSE)
    for car in town.parked_cars:
        corners_m = rectangle(car.xy_m[None], np.array([car.yaw_rad]), car.size_m[None, :2])
        fill(shapely.Polygon(corners_m[0]), colours.PARKED)
    for prop in town.props:
        radius_px = max(prop.radius_m, 0.25) * px_per_m
        fill_colour = _PROPS.get(prop.kind, colours.PROP)
        canvas.dot(place(pixel_from_town, prop.xy_m), radius_px, fill_colour)
    return Ground(canvas.picture(), pixel_from_town)


def rectangle(xy_m: FloatArray, yaw_rad: FloatArray, size_m: FloatArray) -> FloatArray:
    """[A, 4, 2] corners of boxes with middles [A, 2]: front left, rear left, rear right, front."""
    half = 0.5 * np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])
    corners_m = half[None] * size_m[:, None]
    placed: FloatArray = xy_m[:, None] + turn(corners_m, yaw_rad[:, None])
    return placed


def _stripes(outline_m: FloatArray, path_m: FloatArray) -> shapely.Geometry:
    """A crosswalk's stripes: every other piece of the way across, each across the way."""
    across = path_m[1] - path_m[0]
    length_m = float(np.hypot(*across))
    yaw = direction_of(across)
    middles_m = np.arange(_CROSSWALK_STRIPE_M / 2, length_m, 2 * _CROSSWALK_STRIPE_M)
    at_m = path_m[0] + np.outer(middles_m, across / length_m)
    sizes_m = np.tile([_CROSSWALK_STRIPE_M, 20.0], (len(at_m), 1))
    stripes = shapely.polygons(rectangle(at_m, np.full(len(at_m), yaw), sizes_m))
    return shapely.intersection(shapely.union_all(stripes), shapely.Polygon(outline_m))
