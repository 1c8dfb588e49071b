"""Records of annotations as arrays: what each box is of, where it is, how large."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from lss_core.data.tables.by_token import ByToken
from lss_core.data.tables.problems import transform_flaws
from lss_core.data.tables.reading import (
    Annotation,
    Category,
    Instance,
    read_pieces,
    read_table,
    table_path,
)
from lss_core.errors import DataError
from lss_core.geometry import FloatArray, rigid_from_quaternion

_LONGEST_M = 1000.0


def read_kinds(folder: Path) -> ByToken[str]:
    """Instance -> category, as `vehicle.car`.

    Raises:
        DataError: If a table cannot be read, or a token leads nowhere.
    """
    categories = read_table(folder, Category)
    kind = ByToken(folder, Category, Instance, ((c.token, c.name) for c in categories))
    return ByToken(
        folder,
        Instance,
        Annotation,
        (
            (instance.token, kind[instance.category_token])
            for piece in read_pieces(folder, Instance)
            for instance in piece
        ),
    )


def global_from_boxes(folder: Path, records: Sequence[Annotation]) -> FloatArray:
    """[R, 4, 4] frames of boxes: x ahead, y left, z up, from the middle.

    Raises:
        DataError: If one cannot be.
    """
    translation_m = np.asarray([record.translation for record in records])
    quaternion = np.asarray([record.rotation for record in records])
    for record, flaw in zip(
        records, transform_flaws(translation_m, quaternion, is_mounting=False), strict=True
    ):
        if flaw:
            raise _bad(folder, record, flaw)
    return rigid_from_quaternion(translation_m, quaternion)


def sizes_of(folder: Path, records: Sequence[Annotation]) -> FloatArray:
    """[R, 3] length, width and height; the table has width first.

    Raises:
        DataError: If length or width cannot be.
    """
    sizes_m: FloatArray = np.asarray([record.size for record in records])[:, [1, 0, 2]]
    # Comparisons with what is no number are false.
    good = ((sizes_m[:, :2] > 0.0) & (sizes_m[:, :2] < _LONGEST_M)).all(axis=-1)
    if not good.all():
        record = records[int(good.argmin())]
        raise _bad(folder, record, f"size {list(record.size)} m")
    return sizes_m


def _bad(folder: Path, record: Annotation, flaw: str) -> DataError:
    path = table_path(folder, Annotation)
    return DataError(f"Record '{record.token}' of the table '{path}' has {flaw}; mend it.")
