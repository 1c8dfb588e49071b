"""What cameras saw at a planning, with the templates on the ground."""

import cv2
import numpy as np

from lss_core.geometry import FloatArray
from shoot.footprint import EGO_WIDTH_M
from shoot.rendering import palette
from shoot.rendering.camera_panel import project_path, project_ribbon
from shoot.rendering.layout import camera_places
from shoot.rendering.sample_view import Ranking, from_origin
from shoot.simulation.filming.bird_view import probability_colour
from shoot.simulation.filming.canvas import Canvas, Rgb
from shoot.simulation.filming.film import Film
from shoot.simulation.observation import CameraView

_GAP_PX = 2


def draw_cameras(film: Film, plan_idx: int, width_px: int, height_px: int) -> Rgb:
    """[height, width, 3] all cameras, each where it looks; empty places stay dark.

    Args:
        film: The drive.
        plan_idx: Which plan's.
        width_px: Of the whole.
        height_px: Of the whole.
    """
    views = film.views[plan_idx]
    places, rows, columns = camera_places(tuple(view.channel for view in views))
    canvas = Canvas.blank(width_px, height_px, palette.INK)
    cell_wh = width_px // columns, height_px // rows
    for view, (row, column) in zip(views, places, strict=True):
        picture = draw_camera(film, plan_idx, view, cell_wh[0] - _GAP_PX, cell_wh[1] - _GAP_PX)
        canvas.paste(picture, column * cell_wh[0], row * cell_wh[1])
    return canvas.picture()


def draw_camera(
    film: Film,
    plan_idx: int,
    view: CameraView,
    width_px: int,
    height_px: int,
    has_name: bool = True,
) -> Rgb:
    """[height, width, 3] one camera's image, cut to fit, with templates on the ground.

    Args:
        film: The drive.
        plan_idx: Which plan's.
        view: What the camera saw then.
        width_px: Of the panel.
        height_px: Of the panel.
        has_name: Whether the camera's name is written on it.
    """
    pixels = view.pixels()
    scale = max(width_px / pixels.shape[1], height_px / pixels.shape[0])
    resized_wh = round(pixels.shape[1] * scale), round(pixels.shape[0] * scale)
    resized_wh = max(resized_wh[0], width_px), max(resized_wh[1], height_px)
    method = cv2.INTER_CUBIC if scale > 1.0 else cv2.INTER_AREA
    image = cv2.resize(pixels, resized_wh, interpolation=method)
    left, top = (resized_wh[0] - width_px) // 2, (resized_wh[1] - height_px) // 2
    # Whole numbers are middles of pixels, before and after.
    resized_from_raw = np.array(
        [
            [scale, 0.0, 0.5 * scale - 0.5 - left],
            [0.0, scale, 0.5 * scale - 0.5 - top],
            [0.0, 0.0, 1.0],
        ]
    )
    canvas = Canvas(image[top : top + height_px, left : left + width_px])
    camera = (resized_from_raw @ view.rawpixel_from_camera, view.ego_from_camera)
    plan = film.log.plans[plan_idx][1]
    ranking = film.ranking(plan_idx)
    path_m = from_origin(plan.points_m)
    for outline in project_ribbon(path_m, EGO_WIDTH_M, *camera, (height_px, width_px), 0.25):
        canvas.fill([outline], palette.PLANNED, 0.35)
    if ranking is not None:
        _draw_best(canvas, ranking, camera)
    shade = palette.PLANNED if ranking is None else probability_colour(1.0)
    for stretch in project_path(path_m, *camera, (height_px, width_px), 0.25):
        canvas.line(stretch, shade, 3, palette.PAPER)
    if has_name:
        name = view.channel.removeprefix("CAM_").replace("_", " ").lower()
        canvas.text(7, 18, name, 12, palette.PAPER, is_bold=True, casing=palette.INK)
    return canvas.picture()


def _draw_best(canvas: Canvas, ranking: Ranking, camera: tuple[FloatArray, FloatArray]) -> None:
    width_px, height_px = canvas.size
    for path_m, strength in zip(ranking.paths_m[:0:-1], ranking.strengths[:0:-1], strict=True):
        for stretch in project_path(path_m, *camera, (height_px, width_px), 0.25):
            shade = probability_colour(float(strength))
            canvas.line(stretch, shade, 1 + round(float(strength)))
