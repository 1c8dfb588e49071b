"""What numbers of a record cannot be: the rules, and words for what breaks them."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lss_core.data.tables.reading import Record, table_path
from lss_core.geometry import FloatArray

# A rotation's quaternion is as long as this, to within rounding of what wrote it.
_LENGTH_TOLERANCE = 1e-2
# 100,000 km: beyond any map's coordinates, those from the earth's centre included.
_FARTHEST_M = 1e8
_LARGEST_MOUNTING_M = 100.0
_LARGEST_PX = 100_000
# The year 2286 in microseconds: later stamps are in nanoseconds.
_LATEST_US = 1e16
# Between two poses of a car that follow each other.
MAX_STEP_S = 2.0
_MAX_SPEED_MPS = 150.0
_STEP_SLACK_M = 1.0


class Problem(NamedTuple):
    """Why something cannot be used.

    Attributes:
        reason: Its kind, one of few, to count by.
        what: Names file and record.
    """

    reason: str
    what: str


def problem_of(
    reason: str, folder: Path, record_type: type[Record], token: str, flaw: str
) -> Problem:
    """The problem of a record, by table and token; what it has belongs to `flaw`."""
    return Problem(reason, f"record '{token}' of {place_of(folder, record_type)} has {flaw}")


def place_of(folder: Path, record_type: type[Record]) -> str:
    """Words for where records are: the version's folder and the table."""
    return f"{folder.name}/{table_path(folder, record_type).name}"


def time_problem(folder: Path, record: Record, time_us: float) -> Problem:
    """The problem of a record whose time, in microseconds, cannot be."""
    flaw = f"timestamp {time_us:g} microseconds"
    return problem_of("impossible time stamp", folder, type(record), record.token, flaw)


def transform_flaws(
    translation_m: FloatArray, quaternion: FloatArray, is_mounting: bool
) -> NDArray[np.object_]:
    """[R] of texts, empty where translation [R, 3] and quaternion [R, 4] are possible.

    Args:
        translation_m: In metres.
        quaternion: w, x, y, z; its length may be off by 1 %.
        is_mounting: Of a sensor on a car, rather than of a car in the world.
    """
    farthest_m = _LARGEST_MOUNTING_M if is_mounting else _FARTHEST_M
    with np.errstate(over="ignore", invalid="ignore"):
        length = np.linalg.norm(quaternion, axis=-1)
        # Comparisons with what is no number are false.
        is_turn = np.abs(length - 1.0) <= _LENGTH_TOLERANCE
        is_place = (np.abs(translation_m) <= farthest_m).all(axis=-1)
    flaws = np.full(len(length), "", dtype=object)
    for row in np.flatnonzero(~is_place):
        flaws[row] = f"translation {translation_m[row].tolist()} m"
    for row in np.flatnonzero(~is_turn):
        flaws[row] = f"rotation {quaternion[row].tolist()}, a quaternion of length {length[row]:g}"
    return flaws


def intrinsics_flaw(matrix: object) -> str:
    """Empty if rows of numbers are the intrinsics of a pinhole camera."""
    if not isinstance(matrix, list) or [len(line) for line in matrix] != [3, 3, 3]:
        return "no camera_intrinsic of three rows of three"
    values = np.asarray(matrix, dtype=np.float64)
    if _is_pinhole(values):
        return ""
    hint = ", which looks transposed" if _is_pinhole(values.T) else ""
    return f"camera_intrinsic {values.tolist()}{hint}"


def _is_pinhole(values: FloatArray) -> bool:
    focal_px = values[[0, 1], [0, 1]]
    return bool(
        (np.abs(values) <= _LARGEST_PX).all()
        and (focal_px > 0.01).all()
        # Else it cannot be inverted, or is no projection.
        and np.linalg.det(values) > 1e-6
        and values[2].tolist() == [0.0, 0.0, 1.0]
    )


def is_time(time_us: FloatArray) -> NDArray[np.bool_]:
    """Whether numbers can be microseconds since 1970."""
    return np.abs(time_us) <= _LATEST_US


def is_side(side_px: FloatArray) -> NDArray[np.bool_]:
    """Whether numbers can be sides of an image; 0 stands for one that is not known."""
    is_whole: NDArray[np.bool_] = (
        (side_px >= 0) & (side_px <= _LARGEST_PX) & (side_px == np.floor(side_px))
    )
    return is_whole


def step_flaws(
    elapsed_s: FloatArray,
    moved_m: FloatArray,
    name: Callable[[int], str],
    longest_s: float = MAX_STEP_S,
) -> dict[int, Problem]:
    """What no car does from one moment to another, by row.

    Args:
        elapsed_s: [R] time between the two, of either sign.
        moved_m: [R] distance.
        name: Words for the two poses of a row.
        longest_s: More time than this is a gap.
    """
    elapsed_s = np.abs(elapsed_s)
    problems = {}
    for row in np.flatnonzero(moved_m > _STEP_SLACK_M + _MAX_SPEED_MPS * elapsed_s).tolist():
        text = f"{name(row)} are {moved_m[row]:.3g} m apart in {elapsed_s[row]:.3g} s"
        problems[row] = Problem("impossible motion", text)
    for row in np.flatnonzero(elapsed_s > longest_s).tolist():
        problems[row] = Problem("gap in time", f"{name(row)} are {elapsed_s[row]:.3g} s apart")
    return problems


class ProblemList:
    """Problems with numbers, for arrays of what has which; 0 stands for none."""

    def __init__(self) -> None:
        self._number = {Problem("", ""): 0}

    def add(self, problem: Problem) -> int:
        """The problem's number."""
        return self._number.setdefault(problem, len(self._number))

    def mark(
        self,
        numbers: NDArray[np.int64],
        things: NDArray[np.int64],
        problems: Mapping[int, Problem],
    ) -> None:
        """Give numbers to those that have none yet, where a thing (a frame, say) has a problem.

        Args:
            numbers: Of any shape; written to.
            things: Of the same shape; -1 is none.
            problems: By thing.
        """
        if not problems:
            return
        new = np.isin(things, list(problems)) & (numbers == 0)
        bad, which = np.unique(things[new], return_inverse=True)
        own = [self.add(problems[thing]) for thing in bad.tolist()]
        numbers[new] = np.asarray(own, dtype=np.int64)[which]

    @property
    def reasons(self) -> NDArray[np.character]:
        """[Q] by number."""
        return np.asarray([problem.reason for problem in self._number])

    @property
    def texts(self) -> NDArray[np.character]:
        """[Q] by number."""
        return np.asarray([problem.what for problem in self._number])
