"""Two runs, or two methods of several runs each, compared by their reports alone."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from jaxtyping import Float, Int

from lss_core.data.tables.reading import decode_json
from lss_core.errors import DataError
from shoot.evaluation.segmentation.results import TASK, SceneCounts
from shoot.metrics.bootstrap import GroupBootstrap, Interval
from shoot.metrics.overlap import iou

Array = np.ndarray[Any, np.dtype[Any]]


class _File(msgspec.Struct):
    split: str
    by_scene: dict[str, SceneCounts]
    task: str = "planning"


@dataclass(frozen=True)
class SceneOverlaps:
    """What a report says of each scene.

    Attributes:
        name: Of the report, for messages.
        scenes: Names of N scenes.
        groups: What intervals are over: their logs, or themselves.
        classes: Names of C classes.
        overlap: True positives, false positives and false negatives.
    """

    name: str
    scenes: tuple[str, ...]
    groups: tuple[str, ...]
    classes: tuple[str, ...]
    overlap: Int[Array, "N C 3"]


def load_overlaps(path: str | Path) -> SceneOverlaps:
    """Read them from report.json.

    Raises:
        DataError: If there is no such file, or it is no report of a segmentation.
    """
    path = Path(path)
    try:
        stored: _File = decode_json(path.read_bytes(), _File)
        if stored.task != TASK:
            raise ValueError(f"its task is {stored.task}")
        names = sorted(stored.by_scene)
        scenes = [stored.by_scene[name] for name in names]
        if not scenes or any(list(it.classes) != list(scenes[0].classes) for it in scenes):
            raise ValueError("its scenes have no classes in common")
        overlap = np.array(
            [
                [
                    [of_class["true_positives"], of_class["false_positives"],
                     of_class["false_negatives"]]
                    for of_class in scene.classes.values()
                ]
                for scene in scenes
            ],
            dtype=np.int64,
        )  # fmt: skip
    except OSError as error:
        raise DataError(f"'{path}' cannot be read: {error.strerror}.") from error
    except (ValueError, KeyError, RecursionError, msgspec.ValidationError) as error:
        raise DataError(
            f"'{path}' is no report of a segmentation: {error}; write one with shoot-evaluate."
        ) from error
    groups = tuple(it.log or name for it, name in zip(scenes, names, strict=True))
    return SceneOverlaps(str(path), tuple(names), groups, tuple(scenes[0].classes), overlap)


def paired_iou(
    ours: Sequence[SceneOverlaps], theirs: Sequence[SceneOverlaps]
) -> dict[str, Interval]:
    """Our IoU minus theirs in points of per cent, class by class, with paired intervals.

    Of several runs of a method, such as its seeds, the mean of their IoUs counts. Intervals are
    over scenes (or logs): they say whether other scenes would tell the same of these runs, and not
    what other seeds would.

    Args:
        ours: One report or more.
        theirs: As many or not, on the same scenes.

    Returns:
        Of each class that all reports have.

    Raises:
        DataError: If they are of other scenes, or have no class in common.
        ValueError: If there is no report on a side.
    """
    if not ours or not theirs:
        raise ValueError("A comparison needs a report on both sides.")
    first = ours[0]
    for other in (*ours, *theirs):
        if (other.scenes, other.groups) != (first.scenes, first.groups):
            raise DataError(
                f"'{other.name}' is of other scenes than '{first.name}'; evaluate both on one "
                "split."
            )
    shared = [name for name in first.classes if all(name in it.classes for it in (*ours, *theirs))]
    if not shared:
        raise DataError(f"'{first.name}' shares no class with the others; compare other runs.")
    bootstrap = GroupBootstrap(np.array(first.groups))

    def difference(sums: Float[Array, "D J"]) -> Float[Array, " D"]:
        ious = iou(sums.reshape(len(sums), -1, 3))
        less: Array = ious[:, : len(ours)].mean(axis=1) - ious[:, len(ours) :].mean(axis=1)
        return less

    return {
        name: bootstrap.statistic(
            np.concatenate(
                [it.overlap[:, it.classes.index(name)] for it in (*ours, *theirs)], axis=1
            ).astype(np.float64),
            difference,
        )
        for name in shared
    }
