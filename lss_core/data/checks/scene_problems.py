"""Which scenes have a problem: poses that cannot be, contradict each other, or are not there."""

import math
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lss_core.data.checks.heading import heading_offset
from lss_core.data.checks.pose_repairs import likely_mistakes
from lss_core.data.checks.poses import Flaw, find_flaws
from lss_core.data.checks.standing import standing
from lss_core.data.tables.joins import JoinedTables
from lss_core.data.tables.problems import MAX_STEP_S, Problem, place_of, step_flaws
from lss_core.data.tables.reading import EgoPose, SampleData
from lss_core.data.tables.tracks import Tracks

# Poses so many apart are looked at, too: where times are too short, single steps are small.
_FEW = 10


def scene_problems(
    folder: Path, tables: JoinedTables, tracks: Tracks, warnings: list[Problem]
) -> list[tuple[int, Problem]]:
    """Rows of scenes with what is wrong with their poses; of several problems the first counts.

    Args:
        folder: Holds the tables.
        tables: What they say.
        tracks: The poses.
        warnings: To which what may be meant is added.
    """
    whole, single = _flawed(folder, tables, tracks, warnings)
    return [
        *_bad_poses(tables),
        *whole,
        *_bad_steps(folder, tables),
        *single,
        *_no_poses(folder, tables),
    ]


def _bad_poses(tables: JoinedTables) -> Iterable[tuple[int, Problem]]:
    """Scenes with a pose or time that their track should have, or a time that a sample needs."""
    for frame in sorted(tables.pose_problems):
        scene = int(tables.sample_scene[tables.frames.sample[frame]])
        if tables.in_track[frame]:
            yield scene, tables.pose_problems[frame]
    for row, problem in tables.sample_problems.items():
        yield int(tables.sample_scene[row]), problem


def _flawed(
    folder: Path, tables: JoinedTables, tracks: Tracks, warnings: list[Problem]
) -> tuple[list[tuple[int, Problem]], list[tuple[int, Problem]]]:
    """Scenes whose poses contradict gravity, their motion or each other; then single odd places.

    Args:
        folder: Holds the tables.
        tables: What they say.
        tracks: The poses.
        warnings: To which what may be meant is added.
    """
    flaws = find_flaws(tracks)
    mistakes = likely_mistakes(tracks, flaws)
    whole: list[tuple[int, Problem]] = []
    single: list[tuple[int, Problem]] = []
    for scene, flaw in flaws.items():
        problem = _problem_of_flaw(folder, tables, scene, flaw, mistakes.get(scene, ""))
        is_single = flaw.reason == "place off its path" and scene not in mistakes
        (single if is_single else whole).append((scene, problem))
    still, is_sure = standing(tracks)
    if still and is_sure:
        # Their headings turn without motion, which is no mistake of its own.
        own = np.unique(tracks.scene).tolist()
        text = f"{place_of(folder, EgoPose)}: {still}"
        whole = [(scene, Problem("translation without metres", text)) for scene in own]
    elif still:
        warnings.append(Problem("nothing moves", f"{place_of(folder, EgoPose)}: {still}"))
    offset = heading_offset(tracks.motion, list(flaws)) if len(tracks.time_s) else ""
    if offset:
        text = f"{place_of(folder, EgoPose)}: {offset}; is the ego frame that of another sensor?"
        warnings.append(Problem("heading off its motion", text))
    return whole, single


def _problem_of_flaw(
    folder: Path, tables: JoinedTables, scene: int, flaw: Flaw, mistake: str
) -> Problem:
    token = tables.frames.pose_token[tables.track[flaw.row]]
    text = (
        f"record '{token}' of {place_of(folder, EgoPose)} in scene '{tables.scenes[scene].name}'"
        f" is not a car's: {flaw.measured}"
    )
    return Problem(flaw.reason, f"{text}; {mistake}" if mistake else text)


def _bad_steps(folder: Path, tables: JoinedTables) -> Iterable[tuple[int, Problem]]:
    """Scenes whose car does what none does from one pose to the next."""
    time_s = tables.frames.time_us[tables.track] / 1e6
    place_m = tables.global_from_ego[tables.track, :3, 3]
    counts = np.diff(tables.track_start)
    scene = np.repeat(np.arange(len(counts)), counts)
    for ahead in (1, _FEW):
        first = np.flatnonzero(scene[ahead:] == scene[:-ahead])
        second = first + ahead
        elapsed_s = time_s[second] - time_s[first]
        moved_m = np.linalg.norm(place_m[second] - place_m[first], axis=-1)
        longest_s = MAX_STEP_S if ahead == 1 else math.inf

        def name(step: int, first: NDArray[np.int64] = first, ahead: int = ahead) -> str:
            frames = tables.track[[first[step], first[step] + ahead]]
            one, other = (tables.frames.pose_token[frame] for frame in frames)
            return f"records '{one}' and '{other}' of {place_of(folder, EgoPose)}"

        for step, problem in step_flaws(elapsed_s, moved_m, name, longest_s).items():
            yield int(scene[first[step]]), problem


def _no_poses(folder: Path, tables: JoinedTables) -> Iterable[tuple[int, Problem]]:
    for row in np.flatnonzero(np.diff(tables.track_start) == 0).tolist():
        what = f"scene '{tables.scenes[row].token}' has no record in {place_of(folder, SampleData)}"
        yield row, Problem("scene without poses", what)
