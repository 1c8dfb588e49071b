"""Whether the runs say the same when all is made a second time."""

from collections.abc import Sequence

from planning_table.cells import markdown, paired, spread
from planning_table.experiments import PLANNERS
from planning_table.records import Record, bases_of

_METRICS = {"top10": "top-10, %", "nll": "NLL, nats"}


def again_tables(first: Sequence[Record], again: Sequence[Record]) -> list[str]:
    """Planners, and what limits them, from the first records and from the second.

    Args:
        first: What the other tables are made of.
        again: Of the same runs, or of a part; what is in one of the two only is left out.
    """
    names = {r["name"] for r in first} & {r["name"] for r in again}
    if not names:
        return []
    both = [[r for r in records if r["name"] in names] for records in (first, again)]
    return [_setting(both), _planners(*both), _limits(*both)]


def _setting(both: Sequence[Sequence[Record]]) -> str:
    where = []
    for records in both:
        kinds = sorted({f"{r['processor']}, {r['precision']}" for r in records})
        where.append("; ".join(kinds))
    alike = len({r["templates_sha256"] for records in both for r in records}) == 1
    return (
        f"The same made a second time, data set and all: {len(both[1])} runs. First: {where[0]}. "
        f"Again: {where[1]}. The templates are {'the same' if alike else 'others'}."
    )


def _planners(first: Sequence[Record], again: Sequence[Record]) -> str:
    rows = []
    for planner, label in PLANNERS.items():
        own = [[r for r in records if r["planner"] == planner] for records in (first, again)]
        if own[0]:
            row = [label, ", ".join(str(r["seed"]) for r in own[0])]
            for metric in _METRICS:
                row += [_spread(records, metric) for records in own]
                row.append(paired(own[1], own[0], metric))
            rows.append(row)
    header = ["planner", "seeds"]
    for label in _METRICS.values():
        header += [label, "again", "again minus first"]
    return markdown(header, rows) if rows else ""


def _spread(own: Sequence[Record], metric: str) -> str:
    return spread(own, lambda record: record["methods"]["model"][metric], metric)


def _limits(first: Sequence[Record], again: Sequence[Record]) -> str:
    rows = []
    for record in first:
        row = [f"`{record['name']}`"]
        for metric in _METRICS:
            for records in (first, again):
                own = next(r for r in records if r["name"] == record["name"])
                bases = bases_of(own, records)
                row += [paired([own], bases, metric)] if bases else []
        if len(row) > 1:
            rows.append(row)
    if not rows:
        return ""
    header = ["run", "top-10, change", "again", "NLL, change", "again"]
    return "What was changed, from the mean over each time's own seeds:\n\n" + markdown(
        header, rows
    )
