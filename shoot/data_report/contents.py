"""What collisions and off-road rates would rest on: annotated boxes and maps."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from lss_core.data.annotations.boxes import Boxes, has_annotations, read_boxes
from lss_core.data.annotations.categories import is_road_user
from lss_core.data.annotations.drivable import load_drivable_area
from lss_core.data.annotations.map_file import has_map
from lss_core.data.samples import SampleIndex
from lss_core.errors import DataError
from shoot.data_report.facts import CategoryFacts, Finding, LocationFacts

_NAMED = 3


def describe_boxes(
    index: SampleIndex, folder: Path
) -> tuple[tuple[CategoryFacts, ...] | None, tuple[Finding, ...]]:
    """Categories that have boxes, the most frequent first, and what is to be said of the boxes.

    Args:
        index: Of the data set.
        folder: Holds its tables.

    Returns:
        The categories; None without tables of annotations, or if these cannot be used.
    """
    if not has_annotations(folder):
        return None, ()
    try:
        boxes = read_boxes(folder, index, np.arange(len(index.scene_name)))
    except DataError as error:
        text = error.sentence.removesuffix(".")
        return None, (Finding("error", "unusable annotations", "", (text,), 1),)
    most_first = sorted(boxes.num_annotations.items(), key=lambda pair: -pair[1])
    categories = (CategoryFacts(name, num, is_road_user(name)) for name, num in most_first)
    return tuple(categories), tuple(_box_findings(index, boxes))


def _box_findings(index: SampleIndex, boxes: Boxes) -> Iterator[Finding]:
    if boxes.num_unknown:
        named = [f"'{name}' ({num} boxes)" for name, num in boxes.num_unknown.items()]
        where = "collision rates do not count them"
        yield Finding("warning", "unknown categories", where, tuple(named[:_NAMED]), len(named))
    if boxes.num_twins:
        text = f"{boxes.num_twins} boxes lie in another one's very place at the same sample"
        yield Finding("warning", "boxes in one place", "", (text,), 1)
    lacking = [scene for scene in range(len(index.scene_name)) if boxes.lacks_tracks(scene)]
    if lacking:
        where = f"{len(lacking)} of {len(index.scene_name)} scenes"
        named = [f"'{index.scene_name[scene]}'" for scene in lacking]
        yield Finding("warning", "boxes without tracks", where, tuple(named[:_NAMED]), len(named))


def describe_locations(
    index: SampleIndex, root: Path
) -> tuple[tuple[LocationFacts, ...], tuple[Finding, ...]]:
    """Where scenes were, the most frequent first, and what is wrong with their maps.

    Args:
        index: Of the data set.
        root: Its folder, which may hold maps.
    """
    names, counts = np.unique(index.scene_location, return_counts=True)
    facts, flaws = [], []
    for row in np.argsort(-counts, kind="stable").tolist():
        name, on_road = str(names[row]), float("nan")
        is_there = has_map(root, name)
        if is_there:
            here = (index.scene_location == names[row])[index.sample_scene]
            try:
                area = load_drivable_area(root, name)
                on_road = float(area.contains(index.global_from_ego[here, :2, 3]).mean())
            except DataError as error:
                flaws.append(error.sentence.removesuffix("."))
        facts.append(LocationFacts(name, int(counts[row]), is_there, on_road))
    findings = (Finding("error", "unusable map", "", (flaw,), 1) for flaw in flaws)
    return tuple(facts), tuple(findings)
