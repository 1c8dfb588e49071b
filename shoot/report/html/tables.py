"""Tables of means, of differences and of parts, each in a box of its own that scrolls."""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import groupby

from shoot.evaluation.results import KNOWING_SPEED, MODEL, Results
from shoot.metrics.bootstrap import Interval
from shoot.report.html.columns import NLL, TOP_10, Column
from shoot.report.html.markup import Html, element, join
from shoot.report.html.words import DASH, bounds, has_bounds, number, row_class, spaced, verdict

Metrics = Mapping[str, Interval]


def method_table(
    title: str,
    methods: Mapping[str, Metrics],
    columns: Sequence[Column],
    limits: Mapping[str, Metrics] | None = None,
    corner: str = "method",
) -> Html:
    """Methods one below the other, metrics side by side, intervals under the means.

    Args:
        title: What the table holds, shown above it.
        methods: Method -> metric -> mean; a metric that is not there becomes a dash.
        columns: Metrics, in order.
        limits: Rows below that are no methods, such as the driver's own path; one that has none of
            the metrics is left out.
        corner: What rows are.
    """
    rows = [_row(name, metrics, columns, row_class(name)) for name, metrics in methods.items()]
    rows += [
        _row(name, metrics, columns, "bound")
        for name, metrics in (limits or {}).items()
        if any(column.key in metrics for column in columns)
    ]
    return _table(title, _head(corner, columns), rows)


def difference_table(
    title: str,
    differences: Mapping[str, Metrics],
    columns: Sequence[Column],
    whose: str = MODEL,
) -> Html:
    """Model, or who is named, minus each other; bold, with a verdict, if it differs for sure."""
    rows = [
        _row(name, metrics, columns, "method", signed=True) for name, metrics in differences.items()
    ]
    return _table(title, _head(f"{whose} minus", columns), rows)


def summary_table(title: str, overall: Results) -> Html:
    """Planner and baselines, a line each: top-10 and NLL, and the planner's lead in them."""
    columns = [
        Column(column.key, column.name, label, column.decimals)
        for column in (TOP_10, NLL)
        for label in ("mean", f"{MODEL} minus it")
    ]
    rows = []
    for name, metrics in overall.methods.items():
        if name == KNOWING_SPEED:
            continue
        cells = []
        for column in (TOP_10, NLL):
            cells.append(_cell(metrics, column, is_first=True))
            cells.append(_cell(overall.differences.get(name, {}), column, signed=True))
        header = element("th", spaced(name), scope="row")
        rows.append(element("tr", header, *cells, class_=row_class(name)))
    return _table(title, _head("method", columns), rows, "scroll summary")


def part_table(title: str, parts: Mapping[str, Results]) -> Html:
    """Parts of the samples one below the other, top-10 and NLL of each method side by side."""
    methods = list(dict.fromkeys(name for part in parts.values() for name in part.methods))
    columns = [
        Column(column.key, spaced(name), column.name, column.decimals)
        for name in methods
        for column in (TOP_10, NLL)
    ]
    counts = [Column("", "samples", decimals=0), Column("", "scenes", decimals=0)]
    rows = []
    for part, results in parts.items():
        cells = [
            element("td", str(results.num_samples)),
            element("td", str(results.num_scenes)),
        ]
        for name in methods:
            metrics = results.methods.get(name, {})
            cells.append(_cell(metrics, TOP_10, is_first=True))
            cells.append(_cell(metrics, NLL))
        rows.append(element("tr", element("th", part, scope="row"), *cells))
    return _table(title, _head("part", [*counts, *columns]), rows)


def _table(title: str, head: Html, rows: Iterable[Html], class_: str = "scroll") -> Html:
    table = element("table", element("caption", title), head, element("tbody", *rows))
    return element("div", table, class_=class_, role="region", aria_label=title, tabindex=0)


def _head(corner: str, columns: Sequence[Column]) -> Html:
    """One line of headers, or two if any heading has labels beneath."""
    num_lines = 2 if any(column.label for column in columns) else 1
    upper = [element("th", corner, scope="col", rowspan=num_lines, class_="name")]
    lower = []
    for heading, members in _by_heading(columns):
        if not members[0].label:
            upper += [
                element("th", heading, scope="col", rowspan=num_lines, class_="first")
                for _ in members
            ]
            continue
        upper.append(element("th", heading, scope="colgroup", colspan=len(members), class_="first"))
        lower += [
            element("th", column.label, scope="col", class_=_edge(idx == 0))
            for idx, column in enumerate(members)
        ]
    lines = [element("tr", *upper)]
    if lower:
        lines.append(element("tr", *lower))
    return element("thead", *lines)


def _by_heading(columns: Sequence[Column]) -> Iterator[tuple[str, list[Column]]]:
    for heading, members in groupby(columns, key=lambda column: column.heading):
        yield heading, list(members)


def _row(
    name: str, metrics: Metrics, columns: Sequence[Column], class_: str, signed: bool = False
) -> Html:
    cells = [
        _cell(metrics, column, signed, is_first=column is members[0])
        for _, members in _by_heading(columns)
        for column in members
    ]
    return element("tr", element("th", spaced(name), scope="row"), *cells, class_=class_)


def _cell(metrics: Metrics, column: Column, signed: bool = False, is_first: bool = False) -> Html:
    """A mean, its interval beneath if there is one; a dash for what is not there."""
    interval = metrics.get(column.key)
    if interval is None or not math.isfinite(interval.value):
        return element("td", DASH, class_=_edge(is_first))
    value: str = number(interval.value, column.decimals, signed)
    beneath: list[Html] = []
    if has_bounds(interval):
        text = bounds(interval, column.decimals, signed)
        beneath.append(element("span", text, class_="range"))
        if signed and interval.excludes_zero:
            value = element("strong", value)
            beneath.append(element("span", verdict(interval, column), class_="verdict"))
    return element("td", value, join(*beneath), class_=_edge(is_first))


def _edge(is_first: bool) -> str:
    """Class of a cell that begins, or continues, what stands under one heading."""
    return "first" if is_first else "next"
