"""Which samples belong to a split."""

import logging
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lss_core.data.samples.index import SampleIndex
from lss_core.data.splits import has_own_splits, scenes_of_split
from lss_core.errors import DataError

logger = logging.getLogger(__name__)


def rows_of_split(
    index: SampleIndex, root: str | Path, version: str, split: str
) -> NDArray[np.int64]:
    """Rows of the samples whose scene belongs to a split, in the order of scenes and times.

    Of an official split a part may be there, which is logged: people have parts of nuScenes. A list
    of one's own says what is there.

    Raises:
        DataError: If the split is unknown, none of its scenes is in the data set, or one of those
            that the data set's own `splits.json` lists is not.
    """
    folder = Path(root) / version
    names = scenes_of_split(folder, split)
    wanted = np.isin(index.scene_name, list(names))
    rows = np.flatnonzero(wanted[index.sample_scene])
    if not len(rows):
        raise DataError(
            f"None of the {len(names)} scenes of split '{split}' is in {folder}; "
            "check the version and the split, or name the scenes of splits in splits.json there."
        )
    _check_whole(index, folder, split, names)
    order = np.lexsort((index.time_s[rows], index.sample_scene[rows]))
    ordered: NDArray[np.int64] = rows[order]
    return ordered


def _check_whole(index: SampleIndex, folder: Path, split: str, names: tuple[str, ...]) -> None:
    present = set(index.scene_name.tolist())
    missing = [name for name in dict.fromkeys(names) if name not in present]
    if missing and has_own_splits(folder):
        raise DataError(
            f"{len(missing)} of the {len(set(names))} scenes that {folder / 'splits.json'} lists "
            f"for split '{split}' are not in the tables, the first is '{missing[0]}'."
        )
    if missing:
        num = len(set(names))
        logger.warning(
            "Split '%s': %d of %d scenes are in the tables.", split, num - len(missing), num
        )
