"""The index of a data set, from the cache or from its tables.

The tables are walked once per data set; the index is kept on disk, under the size and time stamp of
every table, and mapped from there: processes that use it share its memory.
"""

import hashlib
import json
import logging
import os
from collections.abc import Iterable
from dataclasses import fields
from pathlib import Path

from lss_core.data.samples.building import build_index
from lss_core.data.samples.index import SampleIndex
from lss_core.data.tables.array_file import map_arrays, save_arrays
from lss_core.data.tables.reading import TABLES
from lss_core.errors import DataError
from lss_core.legible import legible

logger = logging.getLogger(__name__)

_FORMAT = 6


def load_index(root: str | Path, version: str, cameras: Iterable[str]) -> SampleIndex:
    """The index of a data set, from the cache if the tables have not changed since.

    What looks like a mistake but may be meant is logged each time.

    Args:
        root: Folder that holds the version's folder.
        version: Name of the tables' folder, as `v1.0-trainval`.
        cameras: Channels to index, in this order.

    Raises:
        DataError: If the folder, the version, a table or a camera is missing or unreadable.
    """
    index = _cached_index(Path(root), version, tuple(cameras))
    for text in index.warning_text.tolist():
        logger.warning("%s.", legible(text))
    return index


def _cached_index(root: Path, version: str, cameras: tuple[str, ...]) -> SampleIndex:
    tables = _check_tables(root, version)
    stamp = [str(root.resolve()), version, _FORMAT, cameras]
    for table in tables:
        stat = table.stat()
        stamp += [table.name, stat.st_size, stat.st_mtime_ns]
    key = hashlib.sha256(json.dumps(stamp).encode()).hexdigest()[:24]
    cache = _cache_folder() / f"index-{key}.arrays"
    if cache.exists():
        try:
            return SampleIndex(**map_arrays(cache))
        except (OSError, ValueError, TypeError) as error:
            logger.warning(
                "The cached index %s is unreadable (%s); building it anew.", cache, error
            )
    index = build_index(root, version, cameras)
    try:
        save_arrays(cache, {f.name: getattr(index, f.name) for f in fields(SampleIndex)})
        # The memory of the mapped one is shared.
        return SampleIndex(**map_arrays(cache))
    except (OSError, ValueError) as error:
        logger.warning("The index could not be cached in %s: %s.", cache, error)
        return index


def _cache_folder() -> Path:
    override = os.environ.get("SHOOT_CACHE")
    if override:
        return Path(override)
    return Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "shoot"


def _check_tables(root: Path, version: str) -> list[Path]:
    if not root.is_dir():
        raise DataError(f"The data root '{root}' is not a folder; point --data.root at nuScenes.")
    folder = root / version
    if not folder.is_dir():
        found = sorted(p.parent.name for p in root.glob("*/sample_data.json"))
        hint = f"found {', '.join(found)}" if found else "no version with tables is there"
        raise DataError(f"There is no version '{version}' in '{root}' ({hint}).")
    tables = [folder / f"{name}.json" for name in TABLES.values()]
    missing = [table.name for table in tables if not table.is_file()]
    if missing:
        raise DataError(
            f"The version folder '{folder}' lacks {', '.join(missing)}; "
            "is the data set unpacked and written to its end?"
        )
    return tables
