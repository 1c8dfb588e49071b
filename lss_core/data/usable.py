"""Which samples can be used: bad ones end a command, or are left out, counted and listed."""

import functools
import json
import logging
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lss_core.data.samples import SampleIndex
from lss_core.data.sensors.file_checks import image_problem, sweep_problem
from lss_core.data.sensors.lidar import recent_sweeps
from lss_core.data.sensors.sweep_cuts import SceneSweeps
from lss_core.data.tables.problems import Problem
from lss_core.errors import DataError
from lss_core.files import write_atomically
from lss_core.legible import legible
from lss_core.progress import progress

logger = logging.getLogger(__name__)

# The file that lists what was left out, where there is one for a folder.
LEFT_OUT = "left_out.json"
_NAMED = 3


@dataclass(frozen=True)
class LeftOut:
    """Something that cannot be used.

    Attributes:
        scene: Its scene's name.
        sample: Its token; empty if it is the scene as a whole.
        reason: One of few, to count by.
        what: Names file and record.
    """

    scene: str
    sample: str
    reason: str
    what: str


@dataclass(frozen=True)
class Usable:
    """What is left of some samples.

    Attributes:
        rows: [R] of them.
        left_out: The others.
    """

    rows: NDArray[np.int64]
    left_out: tuple[LeftOut, ...]


@dataclass(frozen=True)
class Needs:
    """Which sensors of a sample are read.

    Attributes:
        images: Those of all cameras that the tables list; at least one.
        lidar_scans: The keyframe's sweep and those before it, this many in all.
    """

    images: bool = True
    lidar_scans: int = 0

    @staticmethod
    def of_planner(lidar_scans: int, with_points: bool = False) -> "Needs":
        """Of one that sees images, or lidar scans instead; `with_points`: a sweep beside images."""
        if lidar_scans:
            return Needs(images=False, lidar_scans=lidar_scans)
        return Needs(lidar_scans=int(with_points))


def scene_problem(index: SampleIndex, row: int) -> Problem | None:
    """What is wrong with the poses of a sample's scene."""
    number = int(index.scene_problem[index.sample_scene[row]])
    return index.problem(number) if number else None


def record_problem(index: SampleIndex, row: int, needs: Needs) -> Problem | None:
    """What is wrong with what the tables say of a sample: poses, calibration, image sizes."""
    numbers = [int(index.scene_problem[index.sample_scene[row]])]
    if needs.images:
        numbers += index.camera_problem[row].tolist()
        if not index.has_camera[row].any():
            return Problem("no image", "it has no image in sample_data.json")
    if needs.lidar_scans:
        numbers.append(int(index.lidar_problem[row]))
        if not index.lidar_path[row]:
            return Problem("no lidar sweep", "it has no lidar sweep in sample_data.json")
    return next((index.problem(number) for number in numbers if number), None)


def check_row(index: SampleIndex, row: int, needs: Needs) -> None:
    """Look whether a sample's records can be used.

    Raises:
        DataError: If not.
    """
    problem = record_problem(index, row, needs)
    if problem is not None:
        raise DataError(f"Sample {index.sample_token[row]} cannot be used: {problem.what}.")


def usable_scenes(index: SampleIndex, rows: NDArray[np.int64], skip_bad: bool) -> Usable:
    """The samples whose scenes have poses that can be.

    Args:
        index: Of the data set.
        rows: [R] samples to look at.
        skip_bad: Leave out the others, instead of stopping.

    Raises:
        DataError: If there are others and `skip_bad` is off, or if nothing is left.
    """
    found = {row: scene_problem(index, row) for row in rows.tolist()}
    return _without(index, rows, found, skip_bad)


def usable_rows(
    index: SampleIndex,
    root: Path,
    rows: NDArray[np.int64],
    skip_bad: bool,
    needs: Needs | None = None,
) -> Usable:
    """The samples whose records can be used and whose files are on disk.

    With `skip_bad` each file's size, header and end are looked at, too. Without, only whether it is
    there: a damaged one ends the command when it is read.

    Args:
        index: Of the data set.
        root: Its folder.
        rows: [R] samples to look at.
        skip_bad: Leave out the others, instead of stopping.
        needs: Which sensors they need; images if not given.

    Raises:
        DataError: If there are others and `skip_bad` is off, or if nothing is left.
    """
    needs = needs or Needs()
    files = _Files(index, root, look_inside=skip_bad)
    found: dict[int, Problem | None] = {}
    with progress("Looking at files of samples", len(rows), is_passing=True) as advance:
        for row in rows.tolist():
            found[row] = record_problem(index, row, needs) or files.problem(row, needs)
            advance(1)
    return _without(index, rows, found, skip_bad)


class _Files:
    """Looks at each file once, though scans share sweeps."""

    def __init__(self, index: SampleIndex, root: Path, look_inside: bool) -> None:
        self._index, self._root, self._look_inside = index, root, look_inside
        self._sweep = functools.cache(self._sweep_problem)

    def problem(self, row: int, needs: Needs) -> Problem | None:
        """The first that a sample's files have."""
        index = self._index
        if needs.images:
            for n in np.flatnonzero(index.has_camera[row]).tolist():
                height, width = index.image_hw[row, n].tolist()
                problem = self._image_problem(str(index.image_path[row, n]), (height, width))
                if problem:
                    return problem
        if needs.lidar_scans:
            scene = int(index.sample_scene[row])
            for sweep in recent_sweeps(index, row, needs.lidar_scans):
                problem = self._sweep(index.sweep_path[sweep].decode(), scene)
                if problem:
                    return problem
        return None

    def _image_problem(self, name: str, image_hw: tuple[int, int]) -> Problem | None:
        path = self._root / name
        if not _is_file(path):
            return Problem("missing image", f"'{path}' is missing")
        return image_problem(path, image_hw) if self._look_inside else None

    def _sweep_problem(self, name: str, scene: int) -> Problem | None:
        path = self._root / name
        if not _is_file(path):
            return Problem("missing lidar sweep", f"'{path}' is missing")
        if not self._look_inside:
            return None
        return sweep_problem(path, SceneSweeps.of_scene(self._index, self._root, scene))


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except OSError:  # as of a name that is too long
        return False


def _without(
    index: SampleIndex,
    rows: NDArray[np.int64],
    found: Mapping[int, Problem | None],
    skip_bad: bool,
) -> Usable:
    left_out = tuple(
        LeftOut(
            str(index.scene_name[index.sample_scene[row]]),
            str(index.sample_token[row]),
            problem.reason,
            problem.what.rstrip("."),
        )
        for row, problem in found.items()
        if problem is not None
    )
    if not left_out:
        return Usable(rows, ())
    first = f"sample {left_out[0].sample}: {left_out[0].what}"
    if not skip_bad:
        raise DataError(
            f"{len(left_out)} of {len(rows)} samples cannot be used, the first is {first}; mend "
            "the data set or leave such samples out with --data.skip-bad."
        )
    if len(left_out) == len(rows):
        raise DataError(f"None of {len(rows)} samples can be used, the first is {first}.")
    logger.warning(
        "Left out %d of %d samples: %s. %s.",
        len(left_out),
        len(rows),
        count_reasons(left_out),
        legible("; ".join(f"{one.sample}: {one.what}" for one in left_out[:_NAMED])),
    )
    return Usable(rows[[found[row] is None for row in rows.tolist()]], left_out)


def count_reasons(left_out: Iterable[LeftOut]) -> str:
    """How many there are of each reason, as `2 missing image, 1 impossible pose`."""
    counts = Counter(one.reason for one in left_out)
    return ", ".join(f"{count} {reason}" for reason, count in counts.most_common())


def save_left_out(path: Path, left_out: Mapping[str, Sequence[LeftOut]]) -> None:
    """Write what was left out, as JSON; no file, nor an old one, says that it was nothing.

    Args:
        path: Of the file.
        left_out: By split.
    """
    if not any(left_out.values()):
        path.unlink(missing_ok=True)
        return
    listed = {
        split: {
            "count": len(some),
            "by_reason": dict(Counter(one.reason for one in some).most_common()),
            "list": [asdict(one) for one in some],
        }
        for split, some in left_out.items()
    }
    with write_atomically(path) as stream:
        stream.write((json.dumps(listed, indent=2) + "\n").encode())
