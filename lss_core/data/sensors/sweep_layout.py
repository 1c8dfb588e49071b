"""Whether a sweep's bytes are points of x, y, z, intensity, ring in float32, or look like others.

Points of any other layout whose file can be cut into pieces of 20 bytes read without an error, as
numbers that mean nothing: each column then holds a bit of every quantity.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = np.ndarray[Any, np.dtype[Any]]

POINT_BYTES = 20  # x, y, z, intensity, ring in float32: nuScenes' own layout
LARGEST_M = 10_000.0  # sensors write what is no number, or a huge one, where nothing came back
# Some parts of a file tell as much as all of it; one alone may be a quarter of a turn without a
# negative number. Between their beginnings lies a whole number of points of each layout below.
_NUM_PIECES = 8
_PIECE_BYTES = 10 * 480
# A lidar of a car sees no farther.
_FAR_M = 1000.0
_SHARE = 0.99
# Of fewer points anything may be true by chance.
_FEWEST = 32


@dataclass(frozen=True)
class _Layout:
    """Points as some other tool writes them: the words are for people."""

    kind: str
    num_columns: int
    words: str


_EXPECTED = _Layout("<f4", 5, "")
# The stricter come first: what 64 bits say by chance is no place near a car.
_OTHERS = (
    _Layout("<f8", 5, "float64"),
    _Layout("<f8", 4, "float64 with 4 columns: x, y, z, intensity"),
    _Layout("<f8", 3, "float64 with 3 columns: x, y, z"),
    _Layout(">f4", 5, "float32 with its bytes in the other order"),
    _Layout("<f4", 4, "4 columns: x, y, z, intensity, as KITTI writes"),
    _Layout("<f4", 6, "6 columns: x, y, z, intensity and two more, as of ring and time"),
    _Layout("<f4", 3, "3 columns: x, y, z"),
    _Layout("<f2", 5, "float16"),
    _Layout("<f2", 4, "float16 with 4 columns: x, y, z, intensity"),
)
EXPECTED_WORDS = "expected float32 x, y, z, intensity, ring"


def pieces_of(num_bytes: int) -> list[tuple[int, int]]:
    """Beginnings and ends of the parts of a file of this size that are looked at, in bytes."""
    if num_bytes <= _NUM_PIECES * _PIECE_BYTES:
        return [(0, num_bytes)]
    last = (num_bytes - _PIECE_BYTES) // 480
    starts = np.linspace(0, last, _NUM_PIECES).astype(int) * 480
    return [(int(start), int(start) + _PIECE_BYTES) for start in starts]


def layout_flaw(raw: bytes, num_bytes: int) -> str:
    """What the points look like if not like those of a sweep; empty if they do, or nobody knows.

    A fifth column of any numbers is no flaw, as long as nothing else speaks against it: it is not
    used.

    Args:
        raw: The parts of a file that `pieces_of` names.
        num_bytes: Of the whole file.
    """
    fits = num_bytes % POINT_BYTES == 0
    values = _points(raw, _EXPECTED)
    placed = values[has_place(values)]
    if fits and (not len(values) or _is_sweep(placed)):
        return ""
    for layout in _OTHERS:
        if num_bytes % _bytes_of(layout):
            continue
        read = _points(raw, layout)
        if len(read) >= _FEWEST and has_place(read).mean() >= _SHARE and _is_sweep(read):
            return f"looks like {layout.words}"
    if fits and len(placed) >= _FEWEST and not _has_rings(placed):
        if not _is_near(placed):
            largest_m = np.abs(placed[:, :3]).max()
            return f"has coordinates of up to {largest_m:.3g} m, and no ring numbers"
        if not _is_bright(placed):
            return f"has intensities down to {np.nanmin(placed[:, 3]):.3g}, and no ring numbers"
    return ""


def _points(raw: bytes, layout: _Layout) -> Array:
    """[P, C]; what is left over at the end is not looked at."""
    whole = len(raw) // _bytes_of(layout) * _bytes_of(layout)
    values: Array = np.frombuffer(raw[:whole], dtype=layout.kind).reshape(-1, layout.num_columns)
    with np.errstate(invalid="ignore", over="ignore"):
        return values.astype(np.float64)


def _bytes_of(layout: _Layout) -> int:
    return np.dtype(layout.kind).itemsize * layout.num_columns


def has_place(values: Array) -> NDArray[np.bool_]:
    """[P] whether points are somewhere, by their first three columns."""
    # Comparisons with what is no number are false.
    place: NDArray[np.bool_] = (np.abs(values[:, :3]) <= LARGEST_M).all(axis=-1)
    return place


def _is_sweep(values: Array) -> bool:
    """Whether each column is what it should be: points with places only."""
    if not len(values):
        return False
    num_columns = values.shape[1]
    if not _is_near(values):
        return False
    if num_columns == 3:
        # Of a wrong number of columns each would have all numbers, and all the same spread.
        spread_m = values.std(axis=0)
        return bool(spread_m[2] < 0.5 * spread_m[:2].max())
    return _is_bright(values) and (num_columns != 5 or _has_rings(values))


def _is_near(values: Array) -> bool:
    """Whether places are within reach, and not all of them at the sensor."""
    far_m = np.abs(values[:, :3]).max(axis=-1)
    return bool((far_m <= _FAR_M).mean() >= _SHARE and np.median(far_m) > 1e-3)


def _is_bright(values: Array) -> bool:
    """Whether intensities are not negative; those of no number say nothing."""
    return bool((values[:, 3] < 0.0).mean() <= 1.0 - _SHARE)


def _has_rings(values: Array) -> bool:
    """Whether the fifth column counts something; nuScenes has 0 to 31 there, Lyft always 1."""
    ring = values[:, 4]
    with np.errstate(invalid="ignore"):
        counts = (ring >= -1.0) & (ring <= 65_535.0) & (ring == np.floor(ring))
    return bool((counts | np.isnan(ring)).mean() >= _SHARE)
