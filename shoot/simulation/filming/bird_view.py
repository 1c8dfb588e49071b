"""One moment of a drive from above, the car's heading up."""

from dataclasses import dataclass

import cv2
import numpy as np
import shapely

from lss_core.geometry import FloatArray
from shoot.footprint import footprint_corners, turn
from shoot.rendering import palette
from shoot.rendering.bev_panel import cost_range
from shoot.simulation.filming import colours
from shoot.simulation.filming.canvas import Canvas, Points, Rgb
from shoot.simulation.filming.film import Film
from shoot.simulation.filming.ground import Ground, place, rectangle
from shoot.simulation.plan import CostMap
from shoot.world.traffic.recording import GREEN, RED

_SCALE_M = 10.0
# People are drawn so large at least, or they would not be seen.
_PERSON_M = 0.9
_LIGHT_PX = {RED: 6, GREEN: 3}
_AMBER_PX = 5


@dataclass(frozen=True)
class BirdView:
    """A panel seen from above.

    Attributes:
        width_px, height_px: Of the panel.
        px_per_m: Scale.
        ahead_share: How much of the height lies before the rear axle.
    """

    width_px: int
    height_px: int
    px_per_m: float = 8.5
    ahead_share: float = 0.68

    def pixel_from_ego(self) -> FloatArray:
        """[3, 3] pixels of places in `ego`."""
        scale = self.px_per_m
        middle = 0.5 * (self.width_px - 1)
        return np.array(
            [
                [0.0, -scale, middle],
                [-scale, 0.0, self.ahead_share * (self.height_px - 1)],
                [0.0, 0.0, 1.0],
            ]
        )

    def draw(self, film: Film, ground: Ground, step: int, has_scale: bool = True) -> Rgb:
        """[height, width, 3] that moment.

        Args:
            film: The drive.
            ground: What stands still there.
            step: Which moment of the log.
            has_scale: Whether a bar says how long 10 m are.
        """
        log = film.log
        pixel_from_ego = self.pixel_from_ego()
        pixel_from_town = pixel_from_ego @ np.linalg.inv(_town_from_ego(film, step))
        rgb = ground.seen(pixel_from_town, self.width_px, self.height_px)
        plan_idx = film.plan_at(step)
        if plan_idx is not None:
            planned_at = film.step_of_plan(plan_idx)
            pixel_from_plan = pixel_from_town @ _town_from_ego(film, planned_at)
            cost_map = log.plans[plan_idx][1].cost_map
            if cost_map is not None:
                rgb = _darken(rgb, cost_map, pixel_from_plan)
        canvas = Canvas(rgb)
        _draw_lights(canvas, film, step, pixel_from_town)
        _draw_agents(canvas, film, step, pixel_from_town)
        driven = place(pixel_from_town, log.ego.xy_m[: step + 1])
        canvas.line(driven, palette.DRIVEN, 3, palette.PAPER)
        now = slice(step, step + 1)
        (corners_m,) = footprint_corners(log.ego.xy_m[now], log.ego.yaw_rad[now])
        canvas.fill([place(pixel_from_town, corners_m)], palette.EGO)
        nose_m = np.array([[2.7, 0.0], [1.5, 0.55], [1.5, -0.55]])
        canvas.fill([place(pixel_from_ego, nose_m)], palette.PAPER)
        if plan_idx is not None:
            _draw_plan(canvas, film, plan_idx, pixel_from_plan)
        for mishap in film.mishaps_by(step):
            draw_cross(canvas, place(pixel_from_town, mishap.xy_m))
        if has_scale:
            self._draw_scale(canvas)
        return canvas.picture()

    def _draw_scale(self, canvas: Canvas) -> None:
        left, y = 14.0, self.height_px - 14.0
        ends = np.array([[left, y], [left + _SCALE_M * self.px_per_m, y]])
        canvas.line(ends, palette.INK, 3, palette.PAPER)
        canvas.text(left, y - 8, f"{_SCALE_M:.0f} m", 13, palette.INK, casing=palette.PAPER)


def _town_from_ego(film: Film, step: int) -> FloatArray:
    """[3, 3] places in the town of those in `ego` at a moment."""
    x_m, y_m = film.log.ego.xy_m[step]
    yaw = film.log.ego.yaw_rad[step]
    cos, sin = np.cos(yaw), np.sin(yaw)
    return np.array([[cos, -sin, x_m], [sin, cos, y_m], [0.0, 0.0, 1.0]])


def _darken(rgb: Rgb, cost_map: CostMap, pixel_from_ego: FloatArray) -> Rgb:
    """The ground, darker where it is dear to drive."""
    grid = cost_map.grid
    low, high = cost_range(cost_map.cost)
    dear = np.clip((cost_map.cost - low) / (high - low), 0.0, 1.0)
    ramp = np.asarray(palette.COST(dear))[..., :3].astype(np.float32)
    # Rows of the map run forward, columns to the left; pixel (column, row) is a cell's middle.
    cell_m = grid.cell_m
    ego_from_cell = np.array(
        [
            [0.0, cell_m, grid.x_min_m + 0.5 * cell_m],
            [cell_m, 0.0, grid.y_min_m + 0.5 * cell_m],
            [0.0, 0.0, 1.0],
        ]
    )
    shade = cv2.warpAffine(
        ramp,
        (pixel_from_ego @ ego_from_cell)[:2],
        (rgb.shape[1], rgb.shape[0]),
        flags=cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_CONSTANT,
        borderValue=(1.0, 1.0, 1.0),
    )
    darker: Rgb = np.round(rgb * shade).astype(np.uint8)
    return darker


def _draw_lights(canvas: Canvas, film: Film, step: int, pixel_from_town: FloatArray) -> None:
    """A bar across each lane with lights, where cars stop: its colour what they show."""
    for lane in film.town.lanes:
        if lane.signal is None or lane.stop_at_m is None:
            continue
        state = int(film.log.signal_state[step, lane.signal])
        line = shapely.LineString(lane.centreline_m)
        ends = [line.interpolate(lane.stop_at_m + ahead_m) for ahead_m in (-0.5, 0.5)]
        before_m, after_m = shapely.get_coordinates(ends)
        side_m = 0.5 * lane.width_m * turn(after_m - before_m, np.asarray(0.5 * np.pi))
        middle_m = 0.5 * (before_m + after_m)
        bar = place(pixel_from_town, np.stack([middle_m - side_m, middle_m + side_m]))
        canvas.line(bar, colours.LIGHTS[state], _LIGHT_PX.get(state, _AMBER_PX))


def _draw_agents(canvas: Canvas, film: Film, step: int, pixel_from_town: FloatArray) -> None:
    agents, cast = film.log.agents, film.log.cast
    if not cast.kinds:
        return
    sizes_m = cast.sizes_m[:, :2].copy()
    is_person = np.array([kind == "pedestrian" for kind in cast.kinds])
    sizes_m[is_person] = np.maximum(sizes_m[is_person], _PERSON_M)
    boxes_m = rectangle(agents.xy_m[:, step], agents.yaw_rad[:, step], sizes_m)
    boxes = place(pixel_from_town, boxes_m)
    width_px, height_px = canvas.size
    beyond = ((boxes < -50) | (boxes > [width_px + 50, height_px + 50])).any(axis=(1, 2))
    for i in np.flatnonzero(~beyond):
        box = boxes[i]
        if is_person[i]:
            radius_px = 0.5 * float(np.hypot(*(box[0] - box[1])))
            canvas.dot(box.mean(axis=0), radius_px, colours.PERSON, palette.PAPER)
            continue
        canvas.fill([box], colours.VEHICLE)
        canvas.line(box[[0, 1, 2, 3, 0]], palette.PAPER, 1)
        # The windscreen tells front from back.
        canvas.line(0.72 * box[[0, 3]] + 0.28 * box[[1, 2]], palette.PAPER, 2)
        if agents.is_braking[i, step]:
            canvas.line(box[[1, 2]], colours.BRAKING, 3)


def _draw_plan(canvas: Canvas, film: Film, plan_idx: int, pixel_from_plan: FloatArray) -> None:
    """The plan with a dot each second; the best templates beside it, darker the likelier."""
    plan = film.log.plans[plan_idx][1]
    ranking = film.ranking(plan_idx)
    if ranking is not None:
        for path_m, strength in zip(ranking.paths_m[:0:-1], ranking.strengths[:0:-1], strict=True):
            path = place(pixel_from_plan, path_m)
            shade = probability_colour(float(strength))
            canvas.line(path, shade, 1 + round(float(strength)))
            canvas.dot(path[-1], 3.0, shade, palette.PAPER)
    points = place(pixel_from_plan, np.concatenate([np.zeros((1, 2)), plan.points_m]))
    shade = palette.PLANNED if ranking is None else probability_colour(1.0)
    canvas.line(points, shade, 3, palette.PAPER)
    a_second = max(1, round(1.0 / plan.dt_s))
    for point in points[a_second::a_second]:
        canvas.dot(point, 4.0, shade, palette.PAPER)


def probability_colour(strength: float) -> str:
    """Of a template as probable as this share of the most probable one, as `#rrggbb`."""
    red, green, blue, _ = palette.PROBABILITY(strength)
    return f"#{round(255 * red):02x}{round(255 * green):02x}{round(255 * blue):02x}"


def draw_cross(canvas: Canvas, at: Points) -> None:
    """Something went wrong there."""
    reach = 6.0
    for casing, width_px in ((palette.PAPER, 6), (colours.WRONG, 3)):
        for slope in (1.0, -1.0):
            arm = np.array([reach, slope * reach])
            canvas.line(np.stack([at - arm, at + arm]), casing, width_px)
