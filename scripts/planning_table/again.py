"""Whether the runs say the same when all is made a second time."""

from collections.abc import Sequence

from run_queue import Record

from planning_table.cells import PAIRED, markdown, model_spread, paired
from planning_table.experiments import MAIN_METRICS, PAIRS, PLANNERS
from planning_table.records import bases_of


def again_tables(first: Sequence[Record], again: Sequence[Record]) -> dict[str, str]:
    """Planners, and what limits them, from the first records and from the second.

    Args:
        first: What the other tables are made of.
        again: Of the same runs, or of a part; what is in one of the two only is left out.
    """
    names = {r["name"] for r in first} & {r["name"] for r in again}
    both = [[r for r in records if r["name"] in names] for records in (first, again)]
    return {
        "again-setting": _setting(both) if names else "",
        "again-planners": _planners(*both),
        "again-sensors": _differences(*both),
        "again-changes": _limits(*both),
    }


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
        own = [_of_planner(records, planner) for records in (first, again)]
        if not own[0]:
            continue
        seeds = ", ".join(str(record["seed"]) for record in own[0])
        for name, when, records in ((f"{label}: {seeds}", "first", own[0]), ("", "again", own[1])):
            rows.append([name, when, *(model_spread(records, metric) for metric in MAIN_METRICS)])
        less = [paired(own[1], own[0], m) if m in PAIRED else "" for m in MAIN_METRICS]
        rows.append(["", "again minus first", *less])
    return markdown(["planner: seeds", "", *MAIN_METRICS.values()], rows) if rows else ""


def _differences(first: Sequence[Record], again: Sequence[Record]) -> str:
    rows = []
    for less, more in PAIRS:
        times = [(_of_planner(r, more), _of_planner(r, less)) for r in (first, again)]
        if all(times[0]):
            cells = [paired(*own, metric) for metric in PAIRED for own in times]
            rows.append([PLANNERS[more], PLANNERS[less], *cells])
    return markdown(["planner", "minus", *_header()], rows) if rows else ""


def _of_planner(records: Sequence[Record], planner: str) -> list[Record]:
    return [record for record in records if record["planner"] == planner]


def _limits(first: Sequence[Record], again: Sequence[Record]) -> str:
    rows = []
    for name in (record["name"] for record in first if record["flags"]):
        times = []
        for records in (first, again):
            own = next(record for record in records if record["name"] == name)
            times.append(([own], bases_of(own, records)))
        if all(bases for _, bases in times):
            cells = [paired(*own, metric) for metric in PAIRED for own in times]
            rows.append([f"`{name}`", *cells])
    if not rows:
        return ""
    return "What was changed, from the mean over each time's own seeds:\n\n" + markdown(
        ["run", *_header()], rows
    )


def _header() -> list[str]:
    return [cell for label in PAIRED.values() for cell in (f"{label}: first", "again")]
