"""Beside the pictures: clock, speed, what is planned, and what went wrong so far."""

import numpy as np

from shoot.rendering import palette
from shoot.simulation.filming import colours
from shoot.simulation.filming.canvas import Canvas, Points, Rgb, text_width
from shoot.simulation.filming.film import Film

_EDGE_PX = 18
_LINE_PX = 22
_PLOT_PX = 110
_KEY = (
    (palette.DRIVEN, "driven"),
    (palette.PLANNED, "planned"),
    (colours.ROUTE, "route"),
    (colours.VEHICLE, "cars"),
    (colours.PERSON, "people"),
    (colours.WRONG, "went wrong"),
)


def draw_status(film: Film, step: int, width_px: int, height_px: int) -> Rgb:
    """[height, width, 3] of a moment.

    Args:
        film: The drive.
        step: Which moment of its log.
        width_px: Of the panel.
        height_px: Of the panel.
    """
    canvas = Canvas.blank(width_px, height_px, palette.PAPER)
    speed_mps = float(film.log.ego.speed_mps[step])
    canvas.text(_EDGE_PX, 42, f"{film.time_s(step):.1f} s", 30, palette.INK, is_bold=True)
    speed = f"{speed_mps:.1f} m/s"
    canvas.text(_EDGE_PX + 140, 42, speed, 30, palette.INK, is_bold=True)
    canvas.text(_EDGE_PX + 290, 42, f"{3.6 * speed_mps:.0f} km/h", 18, palette.SOFT_INK)
    top = 72 if width_px < 2 * height_px else 42
    left = _EDGE_PX if width_px < 2 * height_px else _EDGE_PX + 400
    canvas.text(left, top, _of_plan(film, step), 15, palette.SOFT_INK)
    _draw_speed(canvas, film, step, top + 24)
    _draw_mishaps(canvas, film, step, top + 24 + _PLOT_PX + 34, height_px - 60)
    _draw_key(canvas, height_px)
    return canvas.picture()


def _of_plan(film: Film, step: int) -> str:
    idx = film.plan_at(step)
    if idx is None:
        return "The rule driver drives in."
    plan, ranking = film.log.plans[idx][1], film.ranking(idx)
    if ranking is None or plan.template_idx is None:
        return "plan of its own"
    percent = 100.0 * float(ranking.probabilities[0])
    rest = "; none keeps to the route" if plan.is_gate_void else ""
    return f"template {plan.template_idx} of {ranking.num_templates}, {percent:.0f} %{rest}"


def _draw_speed(canvas: Canvas, film: Film, step: int, top: int) -> None:
    """Speed against time until now; red lines are what went wrong."""
    left, right = _EDGE_PX + 26, canvas.size[0] - _EDGE_PX
    speed_mps = film.log.ego.speed_mps
    highest = max(5.0, 5.0 * float(np.ceil(speed_mps.max() / 5.0)))
    bottom = top + _PLOT_PX

    def at(times: Points, values: Points) -> Points:
        x = left + (right - left) * times / max(film.num_steps - 1, 1)
        return np.stack([x, bottom - _PLOT_PX * values / highest], axis=1)

    for level in (0.0, highest):
        ends = at(np.array([0.0, film.num_steps - 1.0]), np.array([level, level]))
        canvas.line(ends, "#d9dee3", 1)
        canvas.text(_EDGE_PX, ends[0, 1] + 4, f"{level:.0f}", 12, palette.SOFT_INK)
    canvas.text(left + 6, top + 13, "m/s", 12, palette.SOFT_INK)
    for mishap in film.mishaps_by(step):
        when = np.full(2, mishap.time_s / film.log.dt_s)
        canvas.line(at(when, np.array([0.0, highest])), colours.WRONG, 2)
    line = at(np.arange(step + 1.0), speed_mps[: step + 1])
    canvas.line(line, palette.DRIVEN, 2)
    canvas.dot(line[-1], 4.0, palette.DRIVEN, palette.PAPER)
    end_s = film.time_s(film.num_steps - 1)
    canvas.text(left, bottom + 16, "0 s", 12, palette.SOFT_INK)
    end = f"{end_s:.0f} s"
    canvas.text(right - text_width(end, 12), bottom + 16, end, 12, palette.SOFT_INK)


def _draw_mishaps(canvas: Canvas, film: Film, step: int, top: int, bottom: int) -> None:
    """The latest that there is room for, the last one below."""
    mishaps = film.mishaps_by(step)
    room = max(1, (bottom - top) // _LINE_PX)
    if not mishaps:
        canvas.text(_EDGE_PX, top + 14, "Nothing has gone wrong.", 15, palette.SOFT_INK)
    for line, mishap in enumerate(mishaps[-room:]):
        y = top + 14 + line * _LINE_PX
        canvas.text(_EDGE_PX, y, f"{mishap.time_s:.1f} s", 15, colours.WRONG, is_bold=True)
        canvas.text(_EDGE_PX + 70, y, mishap.words, 15, palette.INK)


def _draw_key(canvas: Canvas, height_px: int) -> None:
    """What colours mean, on as many lines as it takes."""
    width_px = canvas.size[0]
    lines: list[list[tuple[str, str]]] = [[]]
    x = float(_EDGE_PX)
    for ink, name in _KEY:
        wide = 38 + text_width(name, 13)
        if x + wide > width_px and lines[-1]:
            lines.append([])
            x = float(_EDGE_PX)
        lines[-1].append((ink, name))
        x += wide
    for row, of_line in enumerate(lines):
        x, y = float(_EDGE_PX), float(height_px - 14 - 20 * (len(lines) - 1 - row))
        for ink, name in of_line:
            canvas.line(np.array([[x, y - 5], [x + 14, y - 5]]), ink, 5)
            canvas.text(x + 20, y, name, 13, palette.INK)
            x += 38 + text_width(name, 13)
