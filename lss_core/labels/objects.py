"""Annotated boxes at keyframes, seen from above, in the ego frame of the sample."""

import logging
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lss_core.data.annotations.boxes import has_annotations
from lss_core.data.annotations.records import global_from_boxes, read_kinds, sizes_of
from lss_core.data.samples import SampleIndex
from lss_core.data.tables.reading import Annotation, read_pieces
from lss_core.errors import DataError
from lss_core.geometry import FloatArray, invert
from lss_core.labels.classes import is_of_class

logger = logging.getLogger(__name__)

# Of the face a box stands on, counter-clockwise from above, in halves of its sides.
_BOTTOM = np.array([[1, 1, -1], [-1, 1, -1], [-1, -1, -1], [1, -1, -1]], dtype=np.float64)


@dataclass(frozen=True)
class SeenBoxes:
    """A boxes of the classes asked for, sample by sample.

    Attributes:
        row: [A] of its sample in the index, ascending.
        corners_m: [A, 4, 2] of its bottom face in the sample's ego frame, counter-clockwise.
        is_class: [A, C] of which of the classes asked for it is.
    """

    row: NDArray[np.int64]
    corners_m: FloatArray
    is_class: NDArray[np.bool_]

    def of_sample(self, row: int) -> slice:
        """Rows of a sample's boxes."""
        first, end = np.searchsorted(self.row, [row, row + 1])
        return slice(int(first), int(end))


def read_seen_boxes(
    folder: Path, index: SampleIndex, rows: NDArray[np.int64], classes: tuple[str, ...]
) -> SeenBoxes:
    """Boxes of some samples, whatever their visibility.

    Corners are turned by the full rotations of box and car, then their height is left out. A sample
    without boxes has none; a scene that nobody annotated has samples without boxes, too, which is
    logged.

    Args:
        folder: Holds the tables, which are read a piece at a time.
        index: Of the same tables.
        rows: Of the samples asked about, in the index.
        classes: Of objects.

    Raises:
        DataError: If a table is missing or cannot be read, a box cannot be, or none of the scenes
            of these samples is annotated.
    """
    if not has_annotations(folder):
        raise DataError(
            f"'{folder}' lacks tables of annotations, without which there are no labels of "
            f"{' and '.join(classes)}."
        )
    kind_of = read_kinds(folder)
    scenes = np.unique(index.sample_scene[rows])
    asked = np.flatnonzero(np.isin(index.sample_scene, scenes))
    row_of = dict(zip(index.sample_token[asked].tolist(), asked.tolist(), strict=True))
    wanted = np.zeros(len(index.sample_token), dtype=bool)
    wanted[rows] = True
    annotated = np.zeros(len(index.scene_name), dtype=bool)
    num_of = Counter[str]()
    row, corners_m = [np.zeros(0, dtype=np.int64)], [np.zeros((0, 4, 2))]
    is_class = [np.zeros((0, len(classes)), dtype=bool)]
    members: dict[str, list[bool]] = {}
    for piece in read_pieces(folder, Annotation):
        own = [record for record in piece if record.sample_token in row_of]
        annotated[index.sample_scene[[row_of[record.sample_token] for record in own]]] = True
        own = [record for record in own if wanted[row_of[record.sample_token]]]
        kinds = [kind_of[record.instance_token] for record in own]
        num_of.update(kinds)
        for kind in set(kinds) - set(members):
            members[kind] = [is_of_class(kind, name) for name in classes]
        pairs = [pair for pair in zip(own, kinds, strict=True) if any(members[pair[1]])]
        if not pairs:
            continue
        own = [record for record, _ in pairs]
        row.append(np.asarray([row_of[record.sample_token] for record in own], dtype=np.int64))
        corners_m.append(_corners(folder, index, row[-1], own))
        is_class.append(np.asarray([members[kind] for _, kind in pairs]))
    _check_annotated(folder, index, annotated, scenes)
    _warn_of_none(classes, num_of, members)
    order = np.argsort(np.concatenate(row), kind="stable")
    return SeenBoxes(
        np.concatenate(row)[order],
        np.concatenate(corners_m)[order],
        np.concatenate(is_class)[order],
    )


def _corners(
    folder: Path, index: SampleIndex, rows: NDArray[np.int64], records: list[Annotation]
) -> FloatArray:
    """[R, 4, 2] of boxes, in the ego frames of their samples."""
    ego_from_box = invert(index.global_from_ego[rows]) @ global_from_boxes(folder, records)
    corners_box_m = 0.5 * sizes_of(folder, records)[:, None] * _BOTTOM
    turned = corners_box_m @ np.swapaxes(ego_from_box[:, :3, :3], -1, -2)
    corners_m: FloatArray = (turned + ego_from_box[:, None, :3, 3])[..., :2]
    return corners_m


def _check_annotated(
    folder: Path, index: SampleIndex, annotated: NDArray[np.bool_], scenes: NDArray[np.int64]
) -> None:
    lacking = scenes[~annotated[scenes]]
    if len(scenes) and len(lacking) == len(scenes):
        raise DataError(
            f"Nobody annotated the {len(scenes)} scenes asked for in '{folder}', so there are no "
            "labels of objects; choose a split with annotations."
        )
    if len(lacking):
        logger.warning(
            "%d of %d scenes have no annotations, the first is %s: labels of objects are empty.",
            len(lacking),
            len(scenes),
            index.scene_name[lacking[0]],
        )


def _warn_of_none(
    classes: tuple[str, ...], num_of: Counter[str], members: dict[str, list[bool]]
) -> None:
    for column, name in enumerate(classes):
        if num_of and not any(is_of[column] for is_of in members.values()):
            logger.warning(
                "None of %d annotations is of class '%s'; they are of %s.",
                num_of.total(),
                name,
                ", ".join(sorted(num_of)),
            )
