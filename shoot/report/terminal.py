"""A report as text for a terminal."""

from rich.table import Table
from rich.text import Text

from shoot.evaluation.results import MODEL, Report, Results
from shoot.metrics.bootstrap import name_groups
from shoot.report.cells import as_text, interval_cell, new_table, number, spaced

# More columns than these do not fit beside each other.
_PART_METHODS = 4
_PART_COLUMNS = (("top10", "{:5.1f}"), ("nll", "{:4.2f}"))
_RANKING_COLUMNS = (
    ("top5", "top-5, %", "{:.1f}"),
    ("top10", "top-10, %", "{:.1f}"),
    ("top20", "top-20, %", "{:.1f}"),
    ("nll", "NLL, nats", "{:.2f}"),
)
# The field's moment, or else the latest at which templates have a point.
_MOMENTS_S = (3, 2, 1)


def _driving_columns(moment_s: int) -> tuple[tuple[str, str, str], ...]:
    return (
        ("ece", "ECE\n%", "{:.1f}"),
        ("brier", "Brier", "{:.2f}"),
        ("expected_ade", "exp.\nADE\nm", "{:.2f}"),
        ("min_ade_10", "min\nADE\n10, m", "{:.2f}"),
        (f"l2_at_{moment_s}s", f"L2 at\n{moment_s} s\nm", "{:.2f}"),
        (f"l2_upto_{moment_s}s", f"mean\nL2 to\n{moment_s} s, m", "{:.2f}"),
        (f"collision_{moment_s}s", f"crash\n{moment_s} s\n%", "{:.1f}"),
        (f"off_road_{moment_s}s", f"off-r.\n{moment_s} s\n%", "{:.1f}"),
        ("comfort", "comf.\n%", "{:.0f}"),
    )


def format_table(report: Report, width: int = 80) -> str:
    """The report as text for a terminal.

    Methods by ranking with intervals, and the model's lead; then, without intervals, calibration,
    distances and safety; then the parts, for the model, the prior and the two best of the others.

    Args:
        report: What to show.
        width: Columns of the terminal; 80 are enough for any number of methods.
    """
    parts = (
        _ranking_table(report),
        _driving_table(report),
        Text(_driving_legend(report) + "\n"),
        _parts_table(report),
    )
    return as_text(parts, width)


def _ranking_table(report: Report) -> Table:
    overall = report.overall
    seen = f"; {report.num_seen_scenes} SEEN in training" if report.num_seen_scenes else ""
    table = new_table(
        f"Split '{report.split}': {overall.num_samples} samples of {overall.num_scenes} scenes "
        f"(95 % intervals over {name_groups(report.resampled, overall.num_groups)}){seen}"
    )
    table.add_column("method", max_width=14)
    for _, header, _ in _RANKING_COLUMNS:
        table.add_column(header, justify="right", no_wrap=True)
    for name, metrics in overall.methods.items():
        cells = (interval_cell(metrics[key], form) for key, _, form in _RANKING_COLUMNS)
        table.add_row(Text(spaced(name)), *cells)
    table.add_section()
    if overall.differences:
        table.add_row(Text(f"{MODEL} minus"))
    for name, metrics in overall.differences.items():
        forms = ((key, form.replace("{:", "{:+")) for key, _, form in _RANKING_COLUMNS)
        cells = (interval_cell(metrics[key], form) for key, form in forms)
        table.add_row(Text(spaced(name)), *cells)
    return table


def _driving_table(report: Report) -> Table:
    """Where paths were checked, rates that cannot be told are dashes."""
    overall = report.overall
    rows = dict(overall.methods)
    if overall.driver:
        rows["driver"] = overall.driver
    moment_s = _moment_s(overall)
    was_checked = moment_s is not None and report.rests_on is not None
    columns = [
        column
        for column in _driving_columns(moment_s or 0)
        if (was_checked and _is_check(column[0])) or any(column[0] in it for it in rows.values())
    ]
    table = new_table("Calibration, distances, safety")
    table.add_column("method", max_width=14)
    for _, header, _ in columns:
        table.add_column(header, justify="right", no_wrap=True)
    for name, metrics in rows.items():
        if name == "driver":
            table.add_section()
        cells = (
            Text(number(metrics[key].value, form) if key in metrics else _absent(key))
            for key, _, form in columns
        )
        table.add_row(Text(spaced(name)), *cells)
    return table


def _moment_s(overall: Results) -> int | None:
    """When distances and checks are shown; None where templates have a point at none of these."""
    keys = _keys(overall)
    return next((moment_s for moment_s in _MOMENTS_S if f"l2_at_{moment_s}s" in keys), None)


def _keys(overall: Results) -> set[str]:
    return {key for metrics in overall.methods.values() for key in metrics}


def _is_check(key: str) -> bool:
    return key.startswith(("collision_", "off_road_"))


def _absent(key: str) -> str:
    return "-" if _is_check(key) else ""


def _driving_legend(report: Report) -> str:
    overall = report.overall
    moment_s, keys = _moment_s(overall), _keys(overall)
    points = ["exp. ADE: mean over the whole distribution"]
    if moment_s is not None:
        points[0] += f". L2: distance of the most probable template at {moment_s} s (as UniAD)"
    if f"l2_upto_{moment_s}s" in keys:
        points.append("mean L2: of its distances every 0.5 s until then (as ST-P3, VAD)")
    if any(_is_check(key) and key.endswith(f"_{moment_s}s") for key in keys):
        points.append(f"crash, off-r.: it collides, leaves the road, within {moment_s} s")
    points.append("comf.: its acceleration and jerk are comfortable")
    rests_on = "" if report.rests_on is None else ". ".join(report.rests_on.sentences()) + "."
    return (
        f"{'; '.join(points)}. "
        f"The nearest template is {overall.oracle['ade'].value:.2f} m off (ADE).\n{rests_on}"
    ).rstrip("\n")


def _parts_table(report: Report) -> Table:
    shown = _most_telling(report.overall)
    table = new_table("Part by part: top-10 %, NLL in nats")
    table.add_column("part", no_wrap=True)
    table.add_column("samples", justify="right")
    table.add_column("scenes", justify="right")
    for name in shown:
        table.add_column(spaced(name), justify="right", min_width=10, max_width=10)
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
