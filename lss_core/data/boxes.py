"""Annotated boxes of vehicles and people, read for evaluation only; no planner's input has them."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lss_core.data.problems import transform_flaws
from lss_core.data.samples import SampleIndex
from lss_core.data.tables import (
    ANNOTATION_TABLES,
    Annotation,
    ByToken,
    Category,
    Instance,
    read_pieces,
    read_table,
    table_path,
)
from lss_core.errors import DataError
from lss_core.geometry import FloatArray, rigid_from_quaternion, yaw_of

# Barriers, cones and debris stand at the edge of the road or on it, and may be driven through;
# animals and bicycle racks are few.
KINDS = ("vehicle.", "human.")
_LONGEST_M = 1000.0


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
        annotated: [C] whether a scene of the index was asked for and has an annotation of any kind.
    """

    scene: NDArray[np.int64]
    category: NDArray[np.character]
    size_m: FloatArray
    start: NDArray[np.int64]
    time_s: FloatArray
    xy_m: FloatArray
    yaw_rad: FloatArray
    annotated: NDArray[np.bool_]

    def of_scene(self, scene: int) -> range:
        """Rows of a scene's objects."""
        first, end = np.searchsorted(self.scene, [scene, scene + 1])
        return range(int(first), int(end))

    def track(self, instance: int) -> slice:
        """Rows of an object's annotations."""
        return slice(int(self.start[instance]), int(self.start[instance + 1]))


def has_annotations(folder: Path) -> bool:
    """Whether a version's folder has all tables that `read_boxes` reads."""
    return all(table_path(folder, kind).is_file() for kind in ANNOTATION_TABLES)


def read_boxes(folder: Path, index: SampleIndex, scenes: NDArray[np.int64]) -> Boxes:
    """Boxes of vehicles (`vehicle.*`) and people (`human.*`), of some scenes.

    The table of annotations is read a piece at a time; only what is wanted of it stays in memory.

    Args:
        folder: Holds the tables.
        index: Of the same tables.
        scenes: Rows of the wanted scenes in the index.

    Raises:
        DataError: If a table cannot be read, a token leads nowhere or a box cannot be.
    """
    return _read(folder, index, scenes)


def _read(folder: Path, index: SampleIndex, scenes: NDArray[np.int64]) -> Boxes:
    categories = read_table(folder, Category)
    kind = ByToken(folder, Category, Instance, ((c.token, c.name) for c in categories))
    kind_of = ByToken(
        folder,
        Instance,
        Annotation,
        (
            (instance.token, kind[instance.category_token])
            for piece in read_pieces(folder, Instance)
            for instance in piece
        ),
    )
    wanted = np.flatnonzero(np.isin(index.sample_scene, scenes))
    tokens = index.sample_token[wanted].tolist()
    row_of = dict(zip(tokens, wanted.tolist(), strict=True))
    annotated = np.zeros(len(index.scene_name), dtype=bool)
    number_of: dict[tuple[int, str], int] = {}
    category: list[str] = []
    number, sample, pose, size_m = [], [], [], []
    for piece in read_pieces(folder, Annotation):
        own = [record for record in piece if record.sample_token in row_of]
        annotated[index.sample_scene[[row_of[record.sample_token] for record in own]]] = True
        own = [record for record in own if kind_of[record.instance_token].startswith(KINDS)]
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
        pose.append(_poses(folder, own))
        size_m.append(_sizes(folder, own))
    if not sample:
        return _none(annotated)
    scene_of = np.asarray([scene for scene, _ in number_of], dtype=np.int64)
    # Objects in the order of scenes, in each in the order of the table.
    order = np.argsort(scene_of, kind="stable")
    instance = np.argsort(order)[np.asarray(number)]
    time_s = index.time_s[np.concatenate(sample)]
    rows = np.lexsort((time_s, instance))
    start = np.searchsorted(instance[rows], np.arange(len(order) + 1))
    poses = np.concatenate(pose)[rows]
    return Boxes(
        scene=scene_of[order],
        category=np.asarray(category)[order],
        size_m=np.concatenate(size_m)[rows[start[:-1]]],
        start=start,
        time_s=time_s[rows],
        xy_m=poses[:, :2],
        yaw_rad=poses[:, 2],
        annotated=annotated,
    )


def _poses(folder: Path, records: list[Annotation]) -> FloatArray:
    """[R, 3] x, y and heading."""
    translation_m = np.asarray([record.translation for record in records])
    quaternion = np.asarray([record.rotation for record in records])
    for record, flaw in zip(
        records, transform_flaws(translation_m, quaternion, is_mounting=False), strict=True
    ):
        if flaw:
            raise _bad(folder, record, flaw)
    global_from_box = rigid_from_quaternion(translation_m, quaternion)
    poses: FloatArray = np.concatenate(
        [global_from_box[:, :2, 3], yaw_of(global_from_box)[:, None]], axis=1
    )
    return poses


def _sizes(folder: Path, records: list[Annotation]) -> FloatArray:
    """[R, 2] length and width, which the table has the other way round."""
    sizes_m: FloatArray = np.asarray([record.size for record in records])[:, [1, 0]]
    # Comparisons with what is no number are false.
    good = ((sizes_m > 0.0) & (sizes_m < _LONGEST_M)).all(axis=-1)
    if not good.all():
        record = records[int(good.argmin())]
        raise _bad(folder, record, f"size {list(record.size)} m")
    return sizes_m


def _bad(folder: Path, record: Annotation, flaw: str) -> DataError:
    path = table_path(folder, Annotation)
    return DataError(f"Record '{record.token}' of the table '{path}' has {flaw}; mend it.")


def _none(annotated: NDArray[np.bool_]) -> Boxes:
    whole, numbers, pairs = np.zeros(0, dtype=np.int64), np.zeros(0), np.zeros((0, 2))
    names, start = np.zeros(0, dtype=np.str_), np.zeros(1, dtype=np.int64)
    return Boxes(whole, names, pairs, start, numbers, pairs, numbers, annotated)
