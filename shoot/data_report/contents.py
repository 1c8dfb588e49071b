"""What collisions and off-road rates would rest on: annotated boxes and maps."""

from collections import Counter
from pathlib import Path

import numpy as np

from lss_core.data.boxes import count_boxes, has_annotations
from lss_core.data.categories import is_road_user
from lss_core.data.drivable import has_map
from lss_core.data.samples import SampleIndex
from shoot.data_report.facts import CategoryFacts, LocationFacts


def describe_boxes(folder: Path) -> tuple[CategoryFacts, ...] | None:
    """Categories that have boxes, the most frequent first; None without annotations' tables.

    Args:
        folder: Holds the tables.

    Raises:
        DataError: If a table cannot be read or a token leads nowhere.
    """
    if not has_annotations(folder):
        return None
    counts = Counter(count_boxes(folder))
    return tuple(
        CategoryFacts(name, count, bool(is_road_user(name))) for name, count in counts.most_common()
    )


def describe_locations(index: SampleIndex, root: Path) -> tuple[LocationFacts, ...]:
    """Where scenes were, the most frequent first.

    Args:
        index: Of the data set.
        root: Its folder, which may hold maps.
    """
    names, counts = np.unique(index.scene_location, return_counts=True)
    order = np.argsort(-counts, kind="stable")
    return tuple(
        LocationFacts(str(names[row]), int(counts[row]), has_map(root, str(names[row])))
        for row in order
    )
