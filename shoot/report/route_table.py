"""Driven routes as text for a terminal."""

from rich.table import Table
from rich.text import Text

from shoot.report.cells import as_text, interval_cell, new_table, spaced
from shoot.simulation.routes.summary import Means, Summary

# (section, name, words, form)
_ROWS = (
    ("scores", "driving_score", "driving score", "{:.3f}"),
    ("scores", "nc", "NC no collision at fault", "{:.3f}"),
    ("scores", "dac", "DAC drivable area", "{:.3f}"),
    ("scores", "ddc", "DDC driving direction", "{:.3f}"),
    ("scores", "tlc", "TLC traffic lights", "{:.3f}"),
    ("scores", "ep", "EP progress", "{:.3f}"),
    ("scores", "ttc", "TTC time to collision", "{:.3f}"),
    ("scores", "lk", "LK lane keeping", "{:.3f}"),
    ("scores", "hc", "HC comfort", "{:.3f}"),
    ("scores", "ec", "EC plans agree", "{:.3f}"),
    ("strict_route", "driving_score", "score, route strict", "{:.3f}"),
    ("bench2drive", "score", "Bench2Drive score", "{:.3f}"),
    ("bench2drive", "success", "Bench2Drive success", "{:.3f}"),
    ("facts", "collisions_at_fault", "collisions at fault", "{:.2f}"),
    ("facts", "red_lights", "red lights run", "{:.2f}"),
    ("facts", "off_road_m", "off the road, m", "{:.1f}"),
    ("facts", "against_m", "against traffic, m", "{:.1f}"),
    ("facts", "off_route_m", "off the route, m", "{:.1f}"),
    ("facts", "progress_m", "progress, m", "{:.0f}"),
    ("facts", "stuck_s", "stuck, s", "{:.1f}"),
)
_SHOWN_FAILURES = 5


def format_routes(summary: Summary, width: int = 80) -> str:
    """The summary as text: means with intervals, differences beside them, failures below.

    Args:
        summary: What to show.
        width: Columns of the terminal; 80 are enough for differences to two others.
    """
    return as_text((Text(_above(summary)), _table(summary), Text(_below(summary))), width)


def _table(summary: Summary) -> Table:
    table = new_table("")
    table.add_column("a mean over routes", no_wrap=True)
    table.add_column("", justify="right", no_wrap=True)
    for name in summary.differences:
        table.add_column(Text(f"minus\n{name}"), justify="right")
    section = _ROWS[0][0]
    for of, name, words, form in _ROWS:
        if of != section:
            table.add_section()
            section = of
        differences = (
            _cell(one.means, of, name, form.replace("{:", "{:+"))
            for one in summary.differences.values()
        )
        table.add_row(Text(words), _cell(summary.means, of, name, form), *differences)
    return table


def _cell(means: Means, section: str, name: str, form: str) -> Text:
    mean = means[section].get(name)
    return Text("-") if mean is None else interval_cell(mean, form)


def _above(summary: Summary) -> str:
    settings, towns = summary.settings, summary.num_towns
    return (
        f"{spaced(settings['driver'])}, {settings['mode']}: {summary.num_routes} routes of "
        f"{settings['duration_s']:g} s in {towns} {'town' if towns == 1 else 'towns'}"
        f"{' (95 % intervals over towns)' if towns > 1 else ''}"
    )


def _below(summary: Summary) -> str:
    lines = [
        f"{summary.settings['score']}; not comparable with NAVSIM's leaderboard.",
        "Route strict: who is off the route drives against it.",
    ]
    for route, error in list(summary.failures.items())[:_SHOWN_FAILURES]:
        lines.append(f"Route {route} failed and counts 0: {error}")
    if len(summary.failures) > _SHOWN_FAILURES:
        lines.append(f"{len(summary.failures)} routes failed in all.")
    return "\n".join(lines)
