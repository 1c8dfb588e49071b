"""The tables of docs/results/robustness.md, from records alone."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path

from marked_page import fill_pages
from planning_table.cells import markdown, value_cell
from run_queue import budget_of, load_records

from lss_core.config import CAMERAS
from robustness_table.conditions import (
    DROPS,
    NOISE_RAD,
    PLAIN,
    UNDISTURBED,
    conditions_of,
    curves_of,
)
from robustness_table.paired import gain_cell

# What a table shows of each task; of a segmentation the class that the paper's figures show.
_SHOWN = {
    "segmentation": {"car": "IoU of cars, %"},
    "planning": {"top10": "top-10, %", "nll": "NLL, nats"},
}
_NOISE = {UNDISTURBED: "0 rad"} | {f"noise-{level:g}": f"{level:g} rad" for level in NOISE_RAD}
_DROP = {UNDISTURBED: "0 dropped"} | {f"drop-{num}": f"{num} dropped" for num in DROPS}
_MISSING = {UNDISTURBED: "all cameras"} | {f"without-{c}": f"without {c}" for c in CAMERAS}
_NEW = {
    c.name: f"{c.name} cameras" if c.name in ("4", "all") else c.name for c in conditions_of("four")
}
# Of two askings, each a run and a condition: what the first has over the second.
_Gain = Callable[[tuple[str, str], tuple[str, str]], str]
_NOTHING = "No run of these is finished yet."


def write_tables(folder: Path, root: Path) -> None:
    """Put each table between the markers `robustness-...` of the pages that show it.

    Args:
        folder: Of the records, one for each run and condition.
        root: Folder of README.md and docs/.

    Raises:
        DataError: If no page has a table's markers.
    """
    made = all_tables(folder)
    fill_pages(root, {f"robustness-{n}": text or _NOTHING for n, text in made.items()})


def all_tables(folder: Path) -> dict[str, str]:
    """Name to table, which is empty where no run for it is there."""
    records = load_records(folder)
    made = {}
    for task, shown in _SHOWN.items():
        trained = load_records(folder / "runs" / task)
        made[f"setting-{task}"] = budget_of(trained)
        for metric, label in shown.items():
            cells = {
                (record["run"], record["condition"]): value_cell(record["scores"][metric], metric)
                for record in records
                if record["task"] == task
            }
            gain = partial(gain_cell, folder, task, metric)
            end = task if len(shown) == 1 else f"{task}-{metric}"
            for kind, asked in (("noise", _NOISE), ("drop", _DROP)):
                made[f"{kind}-{end}"] = _curves(cells, curves_of(task, kind), asked, label, gain)
            made[f"missing-{end}"] = _column(cells, PLAIN, _MISSING, label, gain)
            made[f"new-{end}"] = _column(cells, "four", _NEW, label, gain)
    return made


def _curves(
    cells: Mapping[tuple[str, str], str],
    runs: Sequence[str],
    conditions: Mapping[str, str],
    label: str,
    gain: _Gain,
) -> str:
    """A row for each run, and for what it has over the plain one; a column for each condition."""
    rows = []
    for run in runs:
        own = [cells.get((run, condition), "-") for condition in conditions]
        if any(cell != "-" for cell in own):
            rows.append([run, *own])
    for run in runs:
        more = [gain((run, condition), (PLAIN, condition)) for condition in conditions]
        if run != PLAIN and any(cell != "-" for cell in more):
            rows.append([f"{run} minus {PLAIN}", *more])
    if not rows:
        return ""
    return f"{label}:\n\n" + markdown(["trained", *conditions.values()], rows)


def _column(
    cells: Mapping[tuple[str, str], str],
    run: str,
    conditions: Mapping[str, str],
    label: str,
    gain: _Gain,
) -> str:
    """A row for each condition of one run, with what it has over the first of them."""
    first, *others = conditions
    rows = [[conditions[first], cells.get((run, first), "-"), ""]]
    for condition in others:
        more = gain((run, condition), (run, first))
        rows.append([conditions[condition], cells.get((run, condition), "-"), more])
    if all(cell == "-" for _, cell, _ in rows):
        return ""
    return markdown(["asked with", label, f"minus {conditions[first]}"], rows)
