"""The tables of docs/results/segmentation.md, from the records of finished runs alone."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path

from marked_page import fill_pages
from planning_table.cells import markdown, spread, value_cell
from run_queue import Record

from segmentation_table.experiments import CAMERAS, CLASSES, METHODS, OURS
from shoot.evaluation.segmentation.paired import load_overlaps, paired_iou

# Philion and Fidler's tables on nuScenes, IoU in per cent.
_PAPER = {
    "cnn": {"car": 22.78, "vehicle": 24.25, "drivable": 68.96, "lane_boundary": 16.51},
    "frozen": {"car": 25.51, "vehicle": 26.83, "drivable": 61.62, "lane_boundary": 16.95},
    "oft": {"car": 29.72, "vehicle": 30.05, "drivable": 71.69, "lane_boundary": 18.07},
    "ours": {"car": 32.06, "vehicle": 32.07, "drivable": 72.94, "lane_boundary": 19.96},
    "lidar1": {"car": 40.26, "vehicle": 44.48, "drivable": 74.91, "lane_boundary": 25.12},
    "lidar10": {"car": 45.36, "vehicle": 49.51, "drivable": 76.96, "lane_boundary": 26.80},
}
_OBJECTS, _MAP = ("car", "vehicle"), ("drivable", "lane_boundary")
_NOTHING = "No run of these is finished yet."


def write_tables(folder: Path, records: Sequence[Record], root: Path) -> None:
    """Put each table between the markers `segmentation-...` of the pages that show it.

    Args:
        folder: Of the records.
        records: Those in it.
        root: Folder of README.md and docs/.

    Raises:
        DataError: If no page has a table's markers.
    """
    made = all_tables(folder, records)
    fill_pages(root, {f"segmentation-{n}": text or _NOTHING for n, text in made.items()})


def all_tables(folder: Path, records: Sequence[Record]) -> dict[str, str]:
    """Name to table, which is empty where no run for it is there."""
    runs = {name: [r for r in records if r["method"] == name] for name in METHODS}
    runs = {name: own for name, own in runs.items() if own}
    if not runs:
        return dict.fromkeys(("setting", "table1", "table2", "table5", "paired", "rings"), "")
    return {
        "setting": _setting(runs),
        "table1": _iou_table(runs, CAMERAS, _OBJECTS),
        "table2": _iou_table(runs, CAMERAS, _MAP),
        "table5": _iou_table(runs, (OURS, "lidar1", "lidar10"), (*_MAP, *_OBJECTS)),
        "paired": _paired_table(runs, folder),
        "rings": _part_table(runs),
    }


def _setting(runs: dict[str, list[Record]]) -> str:
    one = next(iter(runs.values()))[0]
    seeds = ", ".join(
        f"{METHODS[name]}: {', '.join(str(r['seed']) for r in own)}" for name, own in runs.items()
    )
    minutes = {name: sum(r["train_s"] for r in own) / len(own) / 60.0 for name, own in runs.items()}
    took = ", ".join(f"{METHODS[name]} {value:.0f}" for name, value in minutes.items())
    where = "; ".join(sorted({f"{r['processor']} ({r['precision']})" for r in _all(runs)}))
    return (
        f"{one['world']['train_scenes']} training scenes, {one['num_scenes']} validation scenes, "
        f"{one['num_samples']} validation samples; {one['steps']} steps of {one['batch_size']} "
        f"samples, {one['grid'][0]} x {one['grid'][1]} cells of {one['cell_m']:g} m. "
        f"Seeds: {seeds}. Minutes of training a run, {one['runs_side_by_side']} side by side on "
        f"{where}: {took}."
    )


def _iou_table(
    runs: dict[str, list[Record]], methods: Iterable[str], classes: Collection[str]
) -> str:
    rows = []
    for name in methods:
        if name in runs:
            cells = [_iou(runs[name], of_class) for of_class in classes]
            paper = [f"{_PAPER[name][c]:.2f}" if name in _PAPER else "" for c in classes]
            label = f"**{METHODS[name]}**" if name == OURS else METHODS[name]
            rows.append([label, *cells, *paper])
    if not rows:
        return ""
    first = next(iter(runs.values()))[0]
    for baseline, found in first["baselines"].items():
        cells = [value_cell(found[c]["iou"], "iou") for c in classes]
        rows.append([baseline.replace("_", " "), *cells, *[""] * len(classes)])
    labels = [CLASSES[name] for name in classes]
    return markdown(["method", *labels, *(f"paper: {label}" for label in labels)], rows)


def _iou(own: Sequence[Record], of_class: str) -> str:
    return spread(own, lambda record: record["classes"][of_class]["iou"], "iou")


def _paired_table(runs: dict[str, list[Record]], folder: Path) -> str:
    rows = paired_rows(runs, folder, CLASSES)
    if not rows:
        return ""
    return (
        f"{METHODS[OURS]} minus the others in points of IoU, means over seeds, on the same samples "
        "(paired 95 % intervals over scenes):\n\n" + markdown(["minus", *CLASSES.values()], rows)
    )


def paired_rows(
    runs: Mapping[str, Sequence[Record]], folder: Path, classes: Iterable[str]
) -> list[list[str]]:
    """What ours has over each other method in points of IoU, with paired intervals over scenes.

    Args:
        runs: Method to its records.
        folder: Of the records.
        classes: A column for each.
    """
    overlaps = {
        name: [load_overlaps(folder / f"{record['name']}.json") for record in own]
        for name, own in runs.items()
    }
    rows = []
    for name in overlaps:
        if name != OURS and OURS in overlaps:
            found = paired_iou(overlaps[OURS], overlaps[name])
            cells = [value_cell(asdict(found[c]), "iou", sign=True) for c in classes]
            rows.append([METHODS[name], *cells])
    return rows


def _part_table(runs: dict[str, list[Record]]) -> str:
    rows = []
    shown = [name for name in (OURS, "oft", "lidar1", "lidar10") if name in runs]
    for kind in ("by_distance", "by_condition"):
        for part, first in next(iter(runs.values()))[0][kind].items():
            cells = [_part(runs[name], kind, part) for name in shown]
            rows.append([part, str(first["num_samples"]), *cells])
    header = ["part", "samples", *(METHODS[name] for name in shown)]
    return "IoU of cars in per cent, by distance and by light and weather:\n\n" + markdown(
        header, rows
    )


def _part(own: Sequence[Record], kind: str, part: str) -> str:
    if any(part not in record[kind] for record in own):
        return "-"
    return spread(own, lambda record: record[kind][part]["classes"]["car"]["iou"], "iou")


def _all(runs: dict[str, list[Record]]) -> list[Record]:
    return [record for own in runs.values() for record in own]
