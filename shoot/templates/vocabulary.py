"""Templates as other planners keep them: a plain array of paths, called a vocabulary."""

import hashlib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lss_core.errors import DataError
from lss_core.files import write_atomically
from lss_core.npz import UNREADABLE
from shoot.footprint import headings
from shoot.templates.template_set import MAX_BYTES, TemplateSet
from shoot.trajectories import check_futures


def read_vocabulary(path: str | Path, dt_s: float) -> TemplateSet:
    """Templates from a vocabulary, in its order, with a card that says where they come from.

    Its trajectories are metres in `ego` (x forward, y left), the first point at `dt_s`; a heading
    is left out. The layout of GTRS and Hydra-MDP is x, y, heading at 10 Hz over 4 s: 40 points.

    Args:
        path: A file of numpy (.npy), [K, T, 2] x, y; [K, T, 3] x, y, heading; or the latter as
            [K, 3 T].
        dt_s: Time between points, which the file does not tell.

    Returns:
        Templates that have counted no futures yet.

    Raises:
        DataError: If the file is missing or no vocabulary, or no car can drive so.
    """
    path = Path(path)
    if not path.is_file():
        raise DataError(f"There is no vocabulary '{path}'.")
    try:
        stored = np.load(path, mmap_mode="r", allow_pickle=False)
    except UNREADABLE as error:
        raise DataError(f"'{path}' is no array of numpy (.npy): {error}") from error
    points, layout = _points(stored, path)
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    try:
        check_futures(points.astype(np.float64), dt_s)
    except DataError as error:
        raise DataError(f"'{path}' holds no vocabulary: {error.sentence}") from error
    card = {
        "k": len(points),
        "method": "taken from a vocabulary",
        "num_futures": 0,
        "vocabulary": {"file": path.name, "sha256": digest, "layout": layout},
    }
    return TemplateSet(points, dt_s, np.zeros(len(points), dtype=np.int64), card)


def write_vocabulary(path: str | Path, templates: TemplateSet) -> None:
    """Write [K, T, 3] float32 (.npy): x, y in metres in `ego`, and the heading in radians.

    The heading is the direction of travel, kept where the car stands, see `footprint.headings`.

    Raises:
        OSError: If it cannot be written.
    """
    heading_rad = headings(templates.points.astype(np.float64), templates.dt_s)
    array = np.concatenate([templates.points, heading_rad[..., None]], axis=-1, dtype=np.float32)
    with write_atomically(path) as stream:
        np.save(stream, array, allow_pickle=False)


def _points(stored: Any, path: Path) -> tuple[NDArray[np.float32], str]:
    """[K, T, 2] points of what a file holds, and its layout in words."""
    if not isinstance(stored, np.ndarray):
        raise DataError(f"'{path}' holds several arrays; give one array (.npy).")
    shape = stored.shape
    is_flat = len(shape) == 2 and shape[1] % 3 == 0
    is_path = len(shape) == 3 and shape[2] in (2, 3)
    if stored.dtype.kind not in "fiu" or not (is_flat or is_path) or 0 in shape:
        raise DataError(
            f"'{path}' holds {stored.dtype} {list(shape)}, but a vocabulary is numbers [K, T, 2] "
            "(x, y), [K, T, 3] (x, y, heading) or [K, 3 T]."
        )
    num_values = 3 if is_flat else shape[2]
    num_points = stored.size // num_values
    # Points, counts and a card, as they will be read again.
    if 8 * (num_points + len(stored)) + (1 << 20) > MAX_BYTES:
        raise DataError(f"'{path}' holds {num_points:,} points: more than a template file may.")
    paths = np.asarray(stored).reshape(len(stored), -1, num_values)
    if not np.isfinite(paths).all():
        wrong = int((~np.isfinite(paths)).any(axis=(1, 2)).sum())
        raise DataError(
            f"'{path}' must be finite, but {wrong} of {len(paths)} trajectories are not."
        )
    with np.errstate(over="ignore"):
        points = np.array(paths[..., :2], dtype=np.float32, order="C")
    if points.any() and not points[:, 0].any():
        raise DataError(
            f"Every trajectory of '{path}' begins at the origin: it holds time 0, too; leave its "
            "first point out."
        )
    named = "x, y, heading" if paths.shape[2] == 3 else "x, y"
    return points, f"{list(shape)}: {named}"
