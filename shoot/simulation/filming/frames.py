"""All frames of a film, one after the other: cameras if there are any, bird's eye, and status."""

from collections.abc import Iterator

from shoot.rendering import palette
from shoot.simulation.filming.bird_view import BirdView
from shoot.simulation.filming.camera_views import draw_cameras
from shoot.simulation.filming.canvas import Canvas, Rgb, text_width
from shoot.simulation.filming.film import Film
from shoot.simulation.filming.ground import draw_ground
from shoot.simulation.filming.status_panel import draw_status

WIDTH_PX, HEIGHT_PX = 1280, 720
_HEAD_PX = 40
_BROAD_PX, _NARROW_PX = 864, 416
_CAMERAS_PX = 324


def draw_frames(film: Film) -> Iterator[Rgb]:
    """[HEIGHT_PX, WIDTH_PX, 3] for each moment of the log.

    The bird's eye moves at each of them; cameras show what was seen at the last planning, since
    nothing is seen between.
    """
    ground = draw_ground(film.town, film.log.ego.xy_m, film.log.route_lanes)
    body_px = HEIGHT_PX - _HEAD_PX
    width_px = _NARROW_PX if film.has_images else _BROAD_PX
    bird_view = BirdView(width_px, body_px)
    seen: tuple[int, Rgb] | None = None
    for step in range(film.num_steps):
        canvas = Canvas.blank(WIDTH_PX, HEIGHT_PX, palette.PAPER)
        _draw_head(canvas, film)
        bird = bird_view.draw(film, ground, step)
        if film.has_images:
            # Before the first plan cameras show what is seen at it.
            plan_idx = film.plan_at(step) or 0
            if seen is None or seen[0] != plan_idx:
                seen = plan_idx, draw_cameras(film, plan_idx, _BROAD_PX, _CAMERAS_PX)
            canvas.paste(seen[1], 0, _HEAD_PX)
            status = draw_status(film, step, _BROAD_PX, body_px - _CAMERAS_PX)
            canvas.paste(status, 0, _HEAD_PX + _CAMERAS_PX)
            canvas.paste(bird, _BROAD_PX, _HEAD_PX)
        else:
            canvas.paste(bird, 0, _HEAD_PX)
            canvas.paste(draw_status(film, step, _NARROW_PX, body_px), _BROAD_PX, _HEAD_PX)
        yield canvas.picture()


def _draw_head(canvas: Canvas, film: Film) -> None:
    log = film.log
    canvas.text(18, 27, film.driver, 18, palette.INK, is_bold=True)
    rest = f"{log.mode} traffic, town {log.town_seed}, route {log.seed}"
    x = WIDTH_PX - 18 - text_width(rest, 14)
    canvas.text(x, 26, rest, 14, palette.SOFT_INK)
