"""The tables of docs/results/robustness.md, from records alone."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from marked_page import fill_pages
from planning_table.cells import markdown, value_cell
from run_queue import Record

from lss_core.config import CAMERAS
from robustness_table.conditions import DROPS, NOISE_RAD, PLAIN, conditions_of, curves_of

# What a table shows of each task; of a segmentation the class that the paper's figures show.
_SHOWN = {
    "segmentation": {"car": "IoU of cars, %"},
    "planning": {"top10": "top-10, %", "nll": "NLL, nats"},
}
_NOTHING = "No run of these is finished yet."


def write_tables(records: Sequence[Record], root: Path) -> None:
    """Put each table between the markers `robustness-...` of the pages that show it.

    Args:
        records: One for each run and condition.
        root: Folder of README.md and docs/.

    Raises:
        DataError: If no page has a table's markers.
    """
    made = all_tables(records)
    fill_pages(root, {f"robustness-{n}": text or _NOTHING for n, text in made.items()})


def all_tables(records: Sequence[Record]) -> dict[str, str]:
    """Name to table, which is empty where no run for it is there."""
    found = {(r["task"], r["run"], r["condition"]): r["scores"] for r in records}
    made = {}
    for task, shown in _SHOWN.items():
        noisy, dropped = curves_of(task, "noise"), curves_of(task, "drop")
        for metric, label in shown.items():
            cells = {
                (run, condition): value_cell(scores[metric], metric)
                for (of, run, condition), scores in found.items()
                if of == task
            }
            end = task if len(shown) == 1 else f"{task}-{metric}"
            made[f"noise-{end}"] = _curves(
                cells, noisy, {f"noise-{level:g}": f"{level:g} rad" for level in NOISE_RAD}, label
            )
            # Without any dropped, all cameras as they are.
            made[f"drop-{end}"] = _curves(
                cells, dropped, {f"drop-{num}": f"{num} dropped" for num in DROPS}, label
            )
            missing = {"noise-0": "all cameras"} | {f"without-{c}": f"without {c}" for c in CAMERAS}
            made[f"missing-{end}"] = _column(cells, PLAIN, missing, label)
            new = {condition.name: condition.name for condition in conditions_of("four")}
            made[f"new-{end}"] = _column(cells, "four", new, label)
    return made


def _curves(
    cells: Mapping[tuple[str, str], str],
    runs: Sequence[str],
    conditions: Mapping[str, str],
    label: str,
) -> str:
    """A row for each run, a column for each condition."""
    rows = []
    for run in runs:
        own = [_cell(cells, run, condition) for condition in conditions]
        if any(cell != "-" for cell in own):
            rows.append([run, *own])
    if not rows:
        return ""
    return f"{label}:\n\n" + markdown(["trained", *conditions.values()], rows)


def _column(
    cells: Mapping[tuple[str, str], str], run: str, conditions: Mapping[str, str], label: str
) -> str:
    """A row for each condition of one run."""
    rows = [[text, _cell(cells, run, condition)] for condition, text in conditions.items()]
    if all(cell == "-" for _, cell in rows):
        return ""
    return markdown(["asked with", label], rows)


def _cell(cells: Mapping[tuple[str, str], str], run: str, condition: str) -> str:
    # A run asked without noise is one asked without drops.
    same = {"drop-0": "noise-0", "noise-0": "drop-0"}
    return cells.get((run, condition)) or cells.get((run, same.get(condition, condition)), "-")
