"""A report as text for a terminal."""

import io
import math

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table
from rich.text import Text

from shoot.evaluation.results import MODEL, Report, Results
from shoot.metrics.bootstrap import Interval, name_groups

# More columns than these do not fit beside each other.
_PART_METHODS = 4
_PART_COLUMNS = (("top10", "{:5.1f}"), ("nll", "{:4.2f}"))
_RANKING_COLUMNS = (
    ("top5", "top-5, %", "{:.1f}"),
    ("top10", "top-10, %", "{:.1f}"),
    ("top20", "top-20, %", "{:.1f}"),
    ("nll", "NLL, nats", "{:.2f}"),
)
_DRIVING_COLUMNS = (
    ("ece", "ECE\n%", "{:.1f}"),
    ("brier", "Brier", "{:.2f}"),
    ("expected_ade", "exp.\nADE\nm", "{:.2f}"),
    ("min_ade_10", "min\nADE\n10, m", "{:.2f}"),
    ("l2_at_3s", "L2 at\n3 s\nm", "{:.2f}"),
    ("l2_upto_3s", "mean\nL2 to\n3 s, m", "{:.2f}"),
    ("collision_3s", "crash\n3 s\n%", "{:.1f}"),
    ("off_road_3s", "off-r.\n3 s\n%", "{:.1f}"),
    ("comfort", "comf.\n%", "{:.0f}"),
)
_CHECKED = ("collision_3s", "off_road_3s")


def format_table(report: Report, width: int = 80) -> str:
    """The report as text for a terminal.

    Methods by ranking with intervals, and the model's lead; then, without intervals, calibration,
    distances and safety; then the parts, for the model, the prior and the two best of the others.

    Args:
        report: What to show.
        width: Columns of the terminal; 80 are enough for any number of methods.
    """
    console = Console(file=io.StringIO(), width=width, color_system=None)
    with console.capture() as captured:
        console.print(_ranking_table(report))
        console.print(_driving_table(report.overall, report.rests_on is not None))
        console.print(Text(_driving_legend(report) + "\n"))
        console.print(_parts_table(report))
    return "\n".join(line.rstrip() for line in captured.get().splitlines()).strip("\n")


def _ranking_table(report: Report) -> Table:
    overall = report.overall
    seen = f"; {report.num_seen_scenes} SEEN in training" if report.num_seen_scenes else ""
    table = _table(
        f"Split '{report.split}': {overall.num_samples} samples of {overall.num_scenes} scenes "
        f"(95 % intervals over {name_groups(report.resampled, overall.num_groups)}){seen}"
    )
    table.add_column("method", max_width=14)
    for _, header, _ in _RANKING_COLUMNS:
        table.add_column(header, justify="right", no_wrap=True)
    for name, metrics in overall.methods.items():
        cells = (_cell(metrics[key], form) for key, _, form in _RANKING_COLUMNS)
        table.add_row(Text(_spaced(name)), *cells)
    table.add_section()
    if overall.differences:
        table.add_row(Text(f"{MODEL} minus"))
    for name, metrics in overall.differences.items():
        forms = ((key, form.replace("{:", "{:+")) for key, _, form in _RANKING_COLUMNS)
        cells = (_cell(metrics[key], form) for key, form in forms)
        table.add_row(Text(_spaced(name)), *cells)
    return table


def _driving_table(overall: Results, was_checked: bool) -> Table:
    """Where paths were checked, rates that cannot be told are dashes."""
    rows = dict(overall.methods)
    if overall.driver:
        rows["driver"] = overall.driver
    columns = [
        column
        for column in _DRIVING_COLUMNS
        if (was_checked and column[0] in _CHECKED) or any(column[0] in it for it in rows.values())
    ]
    table = _table("Calibration, distances, safety")
    table.add_column("method", max_width=14)
    for _, header, _ in columns:
        table.add_column(header, justify="right", no_wrap=True)
    for name, metrics in rows.items():
        if name == "driver":
            table.add_section()
        cells = (
            Text(_number(metrics[key].value, form) if key in metrics else _absent(key))
            for key, _, form in columns
        )
        table.add_row(Text(_spaced(name)), *cells)
    return table


def _absent(key: str) -> str:
    return "-" if key in _CHECKED else ""


def _driving_legend(report: Report) -> str:
    overall = report.overall
    has_checks = any(key in metrics for metrics in overall.methods.values() for key in _CHECKED)
    checks = "; crash, off-r.: it collides, leaves the road, within 3 s" if has_checks else ""
    rests_on = "" if report.rests_on is None else ". ".join(report.rests_on.sentences()) + "."
    return (
        "exp. ADE: mean over the whole distribution. L2: distance of the most probable template "
        "at 3 s (as UniAD); mean L2: of its distances at 0.5, 1, ... 3 s (as ST-P3, VAD)"
        f"{checks}; comf.: its acceleration and jerk are comfortable. "
        f"The nearest template is {overall.oracle['ade'].value:.2f} m off (ADE).\n{rests_on}"
    ).rstrip("\n")


def _parts_table(report: Report) -> Table:
    shown = _most_telling(report.overall)
    table = _table("Part by part: top-10 %, NLL in nats")
    table.add_column("part", no_wrap=True)
    table.add_column("samples", justify="right")
    table.add_column("scenes", justify="right")
    for name in shown:
        table.add_column(_spaced(name), justify="right", min_width=10, max_width=10)
    for group in (report.by_manoeuvre, report.by_condition, report.by_speed):
        table.add_section()
        for part, results in group.items():
            cells = (
                Text(
                    " ".join(
                        form.format(results.methods[name][key].value) for key, form in _PART_COLUMNS
                    )
                )
                for name in shown
            )
            table.add_row(part, str(results.num_samples), str(results.num_scenes), *cells)
    return table


def _most_telling(overall: Results) -> list[str]:
    """Model, prior, and those of the others that are best in top-10, in the report's order."""
    first = [name for name in (MODEL, "prior") if name in overall.methods]
    others = [name for name in overall.methods if name not in first]
    best = sorted(others, key=lambda name: -overall.methods[name]["top10"].value)
    chosen = first + best[: _PART_METHODS - len(first)]
    return [name for name in overall.methods if name in chosen]


def _table(title: str) -> Table:
    return Table(title=title, box=SIMPLE_HEAD, padding=(0, 1, 0, 0))


def _cell(interval: Interval, form: str) -> Text:
    """A mean, its interval (if it has one) beneath; as Text, since rich reads [ ] in str."""
    value = _number(interval.value, form)
    if math.isnan(interval.low):
        return Text(value)
    return Text(f"{value}\n[{form.format(interval.low)}, {form.format(interval.high)}]")


def _number(value: float, form: str) -> str:
    return "-" if math.isnan(value) else form.format(value)


def _spaced(name: str) -> str:
    """A name that can be broken into lines."""
    return name.replace("_", " ")
