"""A film as one picture for a page: the way from above, then a few moments side by side."""

import cv2
import numpy as np

from lss_core.geometry import FloatArray
from shoot.rendering import palette
from shoot.simulation.filming.bird_view import BirdView, draw_cross
from shoot.simulation.filming.camera_views import draw_camera
from shoot.simulation.filming.canvas import Canvas, Rgb
from shoot.simulation.filming.film import Film
from shoot.simulation.filming.ground import Ground, draw_ground, place

NUM_MOMENTS = 7
TILE_PX = 220
_BIRD_PX = 260
_CAMERA_PX = 124
_GAP_PX = 4
_JPEG_QUALITY = 85
# Moments nearer to each other than this show the same.
_APART_S = 1.0
_MAP_MARGIN_M = 15.0


def strip_jpeg(film: Film) -> bytes:
    """The strip as a JPEG file's bytes; the same film gives the same."""
    quality = [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY]
    _, encoded = cv2.imencode(".jpg", draw_strip(film)[..., ::-1], quality)
    return bytes(encoded.tobytes())


def draw_strip(film: Film) -> Rgb:
    """[H, W, 3] a map of the whole way, then `NUM_MOMENTS` moments.

    A moment is seen from above, and where there are cameras by the front one of the last planning.
    """
    ground = draw_ground(film.town, film.log.ego.xy_m, film.log.route_lanes)
    camera_px = _CAMERA_PX if film.has_images else 0
    height_px = _BIRD_PX + camera_px
    tiles = [_draw_map(film, ground, TILE_PX, height_px)]
    bird_view = BirdView(TILE_PX, _BIRD_PX, px_per_m=5.5)
    for step in choose_moments(film):
        canvas = Canvas.blank(TILE_PX, height_px, palette.PAPER)
        bird = bird_view.draw(film, ground, step, has_scale=False)
        canvas.paste(bird, 0, camera_px)
        if camera_px:
            canvas.paste(_front(film, step), 0, 0)
        time = f"{film.time_s(step):.1f} s"
        canvas.text(7, height_px - 9, time, 15, palette.INK, is_bold=True, casing=palette.PAPER)
        tiles.append(canvas.picture())
    gap = np.full((height_px, _GAP_PX, 3), 255, np.uint8)
    pieces = [piece for tile in tiles for piece in (tile, gap)][:-1]
    return np.concatenate(pieces, axis=1)


def choose_moments(film: Film, num: int = NUM_MOMENTS) -> list[int]:
    """Steps of the log: the hand-over, the end, where things go wrong, and between them.

    Of more mishaps than there is room for, the first ones are shown.
    """
    last = film.num_steps - 1
    first = film.step_of_plan(0) if film.log.plans else 0
    apart = round(_APART_S / film.log.dt_s)
    chosen = sorted({first, last})
    for mishap in film.mishaps:
        step = min(round(mishap.time_s / film.log.dt_s), last)
        if len(chosen) < num and min(abs(step - other) for other in chosen) >= apart:
            chosen = sorted([*chosen, step])
    while len(chosen) < num:
        gaps = np.diff(chosen)
        if not len(gaps) or gaps.max() < 2:
            break
        widest = int(np.argmax(gaps))
        chosen.insert(widest + 1, chosen[widest] + int(gaps[widest]) // 2)
    return chosen


def _front(film: Film, step: int) -> Rgb:
    """What the front camera, or else the first one, saw at the last planning."""
    plan_idx = film.plan_at(step) or 0
    views = film.views[plan_idx]
    by_channel = {view.channel: view for view in views}
    view = by_channel.get("CAM_FRONT", views[0])
    return draw_camera(film, plan_idx, view, TILE_PX, _CAMERA_PX - _GAP_PX, has_name=False)


def _draw_map(film: Film, ground: Ground, width_px: int, height_px: int) -> Rgb:
    """The whole way, north up, as large as it fits."""
    way_m = film.log.ego.xy_m
    low_m, high_m = way_m.min(axis=0) - _MAP_MARGIN_M, way_m.max(axis=0) + _MAP_MARGIN_M
    scale = float(min(np.array([width_px, height_px]) / (high_m - low_m)))
    pixel_from_town = _centred(0.5 * (low_m + high_m), scale, width_px, height_px)
    canvas = Canvas(ground.seen(pixel_from_town, width_px, height_px))
    way = place(pixel_from_town, way_m)
    canvas.line(way, palette.DRIVEN, 3, palette.PAPER)
    canvas.dot(way[0], 5.0, palette.PAPER, palette.INK)
    canvas.dot(way[-1], 5.0, palette.INK, palette.PAPER)
    for mishap in film.mishaps:
        draw_cross(canvas, place(pixel_from_town, mishap.xy_m))
    return canvas.picture()


def _centred(middle_m: FloatArray, scale: float, width_px: int, height_px: int) -> FloatArray:
    """[3, 3] pixels of places in the town, north up, with one place in the middle."""
    return np.array(
        [
            [scale, 0.0, 0.5 * (width_px - 1) - scale * middle_m[0]],
            [0.0, -scale, 0.5 * (height_px - 1) + scale * middle_m[1]],
            [0.0, 0.0, 1.0],
        ]
    )
