"""Annotated boxes of vehicles and people, read for evaluation only; no planner's input has them."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lss_core.data.annotations.box_tracks import lacks_tracks
from lss_core.data.annotations.categories import is_road_user
from lss_core.data.annotations.records import global_from_boxes, read_kinds, sizes_of
from lss_core.data.samples import SampleIndex
from lss_core.data.tables.reading import (
    ANNOTATION_TABLES,
    Annotation,
    read_pieces,
    table_path,
)
from lss_core.errors import DataError
from lss_core.geometry import FloatArray, yaw_of


@dataclass(frozen=True)
class Boxes:
    """A annotations of I vehicles and people, one object after the other, each increasing in time.

    Attributes:
        scene: [I] row of its scene in the index, ascending.
        category: [I] as `vehicle.car`.
        size_m: [I, 2] length and width at its first annotation; nuScenes keeps them.
        start: [I + 1] where each object's annotations begin.
        time_s: [A] the lidar's time of the keyframe.
        xy_m: [A, 2] centre in `global`.
        yaw_rad: [A] heading in `global`.
        annotated: [C] whether a scene of the index was asked for and has an annotation of a known
            category, of road users or not.
        num_annotations: Category -> annotations in the scenes asked for, all categories.
        num_twins: Boxes that lie in another one's very place, at the same sample.
    """

    scene: NDArray[np.int64]
    category: NDArray[np.character]
    size_m: FloatArray
    start: NDArray[np.int64]
    time_s: FloatArray
    xy_m: FloatArray
    yaw_rad: FloatArray
    annotated: NDArray[np.bool_]
    num_annotations: dict[str, int] = field(default_factory=dict)
    num_twins: int = 0

    @property
    def num_objects(self) -> dict[str, int]:
        """Category -> objects, most first."""
        return _most_first(Counter(self.category.tolist()))

    @property
    def num_unknown(self) -> dict[str, int]:
        """Category -> annotations, of the categories that nobody knows; most first."""
        counts = _most_first(self.num_annotations)
        return {name: num for name, num in counts.items() if is_road_user(name) is None}

    def of_scene(self, scene: int) -> range:
        """Rows of a scene's objects."""
        first, end = np.searchsorted(self.scene, [scene, scene + 1])
        return range(int(first), int(end))

    def only_scenes(self, wanted: NDArray[np.bool_]) -> "Boxes":
        """Without the objects of scenes that are not wanted [C]; these are then not annotated."""
        kept = wanted[self.scene]
        counts = np.diff(self.start)
        rows = np.repeat(kept, counts)
        return replace(
            self,
            scene=self.scene[kept],
            category=self.category[kept],
            size_m=self.size_m[kept],
            start=np.concatenate([[0], np.cumsum(counts[kept])]),
            time_s=self.time_s[rows],
            xy_m=self.xy_m[rows],
            yaw_rad=self.yaw_rad[rows],
            annotated=self.annotated & wanted,
        )

    def lacks_tracks(self, scene: int) -> bool:
        """Whether objects of a scene seem to have another name in each sample."""
        own = np.asarray(self.of_scene(scene), dtype=np.int64)
        first = self.start[own]
        return lacks_tracks(
            self.time_s[first], self.xy_m[first], self.category[own], self.start[own + 1] - first
        )

    def track(self, instance: int) -> slice:
        """Rows of an object's annotations."""
        return slice(int(self.start[instance]), int(self.start[instance + 1]))


def has_annotations(folder: Path) -> bool:
    """Whether a version's folder has all tables that `read_boxes` reads."""
    return all(table_path(folder, kind).is_file() for kind in ANNOTATION_TABLES)


def read_boxes(folder: Path, index: SampleIndex, scenes: NDArray[np.int64]) -> Boxes:
    """Boxes of vehicles and people, of some scenes; `categories` beside this knows their names.

    The table of annotations is read a piece at a time; only what is wanted of it stays in memory.

    Args:
        folder: Holds the tables.
        index: Of the same tables.
        scenes: Rows of the wanted scenes in the index.

    Raises:
        DataError: If a table cannot be read, a token leads nowhere, a box cannot be, or an object
            has two boxes at one sample.
    """
    return _read(folder, index, scenes)


def _read(folder: Path, index: SampleIndex, scenes: NDArray[np.int64]) -> Boxes:
    kind_of = read_kinds(folder)
    wanted = np.flatnonzero(np.isin(index.sample_scene, scenes))
    tokens = index.sample_token[wanted].tolist()
    row_of = dict(zip(tokens, wanted.tolist(), strict=True))
    annotated = np.zeros(len(index.scene_name), dtype=bool)
    number_of: dict[tuple[int, str], int] = {}
    category: list[str] = []
    num_annotations = Counter[str]()
    number, sample, pose, size_m = [], [], [], []
    for piece in read_pieces(folder, Annotation):
        own = [record for record in piece if record.sample_token in row_of]
        num_annotations.update(kind_of[record.instance_token] for record in own)
        counts = {name: is_road_user(name) for name in num_annotations}
        known = [record for record in own if counts[kind_of[record.instance_token]] is not None]
        annotated[index.sample_scene[[row_of[record.sample_token] for record in known]]] = True
        own = [record for record in known if counts[kind_of[record.instance_token]]]
        if not own:
            continue
        rows = [row_of[record.sample_token] for record in own]
        for record, scene in zip(own, index.sample_scene[rows].tolist(), strict=True):
            key = (scene, record.instance_token)
            if key not in number_of:
                number_of[key] = len(number_of)
                category.append(kind_of[record.instance_token])
            number.append(number_of[key])
        sample.append(np.asarray(rows, dtype=np.int64))
        global_from_box = global_from_boxes(folder, own)
        pose.append(np.column_stack([global_from_box[:, :2, 3], yaw_of(global_from_box)]))
        size_m.append(sizes_of(folder, own)[:, :2])
    if not sample:
        return _none(annotated, dict(num_annotations))
    scene_of = np.asarray([scene for scene, _ in number_of], dtype=np.int64)
    # Objects in the order of scenes, in each in the order of the table.
    order = np.argsort(scene_of, kind="stable")
    instance = np.argsort(order)[np.asarray(number)]
    sample_row = np.concatenate(sample)
    time_s = index.time_s[sample_row]
    rows = np.lexsort((sample_row, time_s, instance))
    _check_once(folder, index, list(number_of), order[instance[rows]], sample_row[rows])
    start = np.searchsorted(instance[rows], np.arange(len(order) + 1))
    poses = np.concatenate(pose)[rows]
    places = np.column_stack([sample_row[rows], poses[:, :2]])
    return Boxes(
        scene=scene_of[order],
        category=np.asarray(category)[order],
        size_m=np.concatenate(size_m)[rows[start[:-1]]],
        start=start,
        time_s=time_s[rows],
        xy_m=poses[:, :2],
        yaw_rad=poses[:, 2],
        annotated=annotated,
        num_annotations=dict(num_annotations),
        num_twins=len(places) - len(np.unique(places, axis=0)),
    )


def _check_once(
    folder: Path,
    index: SampleIndex,
    objects: list[tuple[int, str]],
    number: NDArray[np.int64],
    sample_row: NDArray[np.int64],
) -> None:
    """Objects have one box at a sample; the rows stand object by object, in the order of time."""
    twice = np.flatnonzero((np.diff(number) == 0) & (np.diff(sample_row) == 0))
    if not len(twice):
        return
    instance = objects[int(number[twice[0]])][1]
    sample = str(index.sample_token[sample_row[twice[0]]])
    named = [
        record.token
        for piece in read_pieces(folder, Annotation)
        for record in piece
        if (record.instance_token, record.sample_token) == (instance, sample)
    ]
    path = table_path(folder, Annotation)
    raise DataError(
        f"Records '{named[0]}' and '{named[1]}' of the table '{path}' are of one instance '"
        f"{instance}' at one sample '{sample}' ({len(twice)} such pairs): an object has one box at "
        "a time; mend the table."
    )


def _most_first(counts: Mapping[str, int]) -> dict[str, int]:
    return dict(sorted(counts.items(), key=lambda pair: (-pair[1], pair[0])))


def _none(annotated: NDArray[np.bool_], num_annotations: dict[str, int]) -> Boxes:
    whole, numbers, pairs = np.zeros(0, dtype=np.int64), np.zeros(0), np.zeros((0, 2))
    names, start = np.zeros(0, dtype=np.str_), np.zeros(1, dtype=np.int64)
    return Boxes(whole, names, pairs, start, numbers, pairs, numbers, annotated, num_annotations)
