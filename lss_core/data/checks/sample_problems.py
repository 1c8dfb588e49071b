"""Which scenes, images and sweeps have a problem, from what is wrong with single records."""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lss_core.data.checks.calibration import camera_flaws
from lss_core.data.checks.heading import heading_offset
from lss_core.data.checks.image_poses import astray
from lss_core.data.checks.pose_repairs import likely_mistakes
from lss_core.data.checks.poses import Flaw, find_flaws
from lss_core.data.checks.standing import standing
from lss_core.data.tables.joins import JoinedTables
from lss_core.data.tables.problems import MAX_STEP_S, Problem, ProblemList, problem_of, step_flaws
from lss_core.data.tables.reading import CalibratedSensor, EgoPose, Record, SampleData, table_path
from lss_core.data.tables.tracks import Tracks
from lss_core.geometry import FloatArray

# Poses so many apart are looked at, too: where times are too short, single steps are small.
_FEW = 10
# Images this far in time from their samples show another moment.
_LATE_S = 0.2


@dataclass(frozen=True)
class SampleProblems:
    """What the index says of Q problems, of which the first is none.

    Attributes:
        problem_reason: [Q].
        problem_text: [Q].
        scene_problem: [C].
        camera_problem: [S, N].
        lidar_problem: [S].
        warning_reason: [W] of what may be meant.
        warning_text: [W].
    """

    problem_reason: NDArray[np.character]
    problem_text: NDArray[np.character]
    scene_problem: NDArray[np.int64]
    camera_problem: NDArray[np.int64]
    lidar_problem: NDArray[np.int64]
    warning_reason: NDArray[np.character]
    warning_text: NDArray[np.character]


def find_problems(
    folder: Path, tables: JoinedTables, time_s: FloatArray, global_from_ego: FloatArray
) -> SampleProblems:
    """Problems of S samples and C scenes.

    One pose that cannot be is a problem of its scene: futures and pasts are made of all of them.

    Args:
        folder: Holds the tables.
        tables: What they say.
        time_s: [S] of the samples' ego frames.
        global_from_ego: [S, 4, 4].
    """
    problems = ProblemList()
    warnings = _many_keyframes(folder, tables)
    scene = np.zeros(len(tables.scenes), dtype=np.int64)
    tracks = _tracks(tables)
    whole, single = _flawed(folder, tables, tracks, warnings)
    for own, problem in (
        *_bad_poses(tables),
        *whole,
        *_bad_steps(folder, tables),
        *single,
        *_no_poses(folder, tables),
    ):
        scene[own] = scene[own] or problems.add(problem)
    images, lidar = tables.images, tables.lidar
    calibration = np.append(tables.frames.calibration, -1)  # that of the frame -1
    camera = np.zeros(images.shape, dtype=np.int64)
    problems.mark(camera, calibration[images], tables.intrinsics_problems)
    problems.mark(camera, calibration[images], tables.mounting_problems)
    problems.mark(camera, images, tables.pose_problems)
    problems.mark(camera, images, tables.frames.size_problems)
    setups, flaws = _bad_cameras(folder, tables, warnings)
    problems.mark(camera, setups, flaws)
    # Where a scene has a problem, its samples' frames mean nothing that an image could be far from.
    near = np.where((scene == 0)[tables.sample_scene, None], images, -1)
    problems.mark(camera, near, _far_images(folder, tables, near, time_s, global_from_ego))
    problems.mark(camera, near, _astray_images(folder, tables, tracks, near))
    warnings += _late_images(tables, near, time_s)
    of_lidar = np.zeros(len(lidar), dtype=np.int64)
    problems.mark(of_lidar, calibration[lidar], tables.mounting_problems)
    return SampleProblems(
        problem_reason=problems.reasons,
        problem_text=problems.texts,
        scene_problem=scene,
        camera_problem=camera,
        lidar_problem=of_lidar,
        warning_reason=np.asarray([warning.reason for warning in warnings], dtype=np.str_),
        warning_text=np.asarray([warning.what for warning in warnings], dtype=np.str_),
    )


def _many_keyframes(folder: Path, tables: JoinedTables) -> list[Problem]:
    """Of samples for which records of one sensor at several times claim to be the keyframe."""
    rows = np.unique(tables.frames.sample[tables.rivals])
    if not len(rows):
        return []
    first = tables.samples[int(rows[0])].token
    text = (
        f"{len(rows)} of {len(tables.samples)} samples, the first '{first}', have several keyframes"
        f" of one sensor at different times in {_place(folder, SampleData)}; the nearest in time to"
        " the sample is taken: is is_key_frame true for all records?"
    )
    return [Problem("several keyframes", text)]


def _bad_poses(tables: JoinedTables) -> Iterable[tuple[int, Problem]]:
    """Scenes with a pose or time that their track should have, or a time that a sample needs."""
    for frame in sorted(tables.pose_problems):
        scene = int(tables.sample_scene[tables.frames.sample[frame]])
        if tables.in_track[frame]:
            yield scene, tables.pose_problems[frame]
    for row, problem in tables.sample_problems.items():
        yield int(tables.sample_scene[row]), problem


def _tracks(tables: JoinedTables) -> Tracks:
    counts = np.diff(tables.track_start)
    return Tracks(
        time_s=tables.frames.time_us[tables.track] / 1e6,
        scene=np.repeat(np.arange(len(counts)), counts),
        global_from_ego=tables.global_from_ego[tables.track],
    )


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
        text = f"{_place(folder, EgoPose)}: {still}"
        whole = [(scene, Problem("translation without metres", text)) for scene in own]
    elif still:
        warnings.append(Problem("nothing moves", f"{_place(folder, EgoPose)}: {still}"))
    offset = heading_offset(tracks.motion, list(flaws)) if len(tracks.time_s) else ""
    if offset:
        text = f"{_place(folder, EgoPose)}: {offset}; is the ego frame that of another sensor?"
        warnings.append(Problem("heading off its motion", text))
    return whole, single


def _problem_of_flaw(
    folder: Path, tables: JoinedTables, scene: int, flaw: Flaw, mistake: str
) -> Problem:
    token = tables.frames.pose_token[tables.track[flaw.row]]
    text = (
        f"record '{token}' of {_place(folder, EgoPose)} in scene '{tables.scenes[scene].name}' is "
        f"not a car's: {flaw.measured}"
    )
    return Problem(flaw.reason, f"{text}; {mistake}" if mistake else text)


def _bad_cameras(
    folder: Path, tables: JoinedTables, warnings: list[Problem]
) -> tuple[NDArray[np.int64], dict[int, Problem]]:
    """[S, N] number of the calibration and size of each image; what is wrong with those, by number.

    Args:
        folder: Holds the tables.
        tables: What they say.
        warnings: To which what may be meant is added.
    """
    present = tables.images >= 0
    frames = tables.images[present]
    calibration, image_hw = tables.frames.calibration[frames], tables.frames.image_hw[frames]
    side = int(image_hw.max(initial=0)) + 1
    # One number each: unique rows take much longer.
    keys = (calibration * side + image_hw[:, 0]) * side + image_hw[:, 1]
    _, first, number = np.unique(keys, return_index=True, return_inverse=True)
    setups = np.full(tables.images.shape, -1, dtype=np.int64)
    setups[present] = number
    calibration, image_hw = calibration[first], image_hw[first]
    impossible = [*tables.intrinsics_problems, *tables.mounting_problems]
    sound = np.flatnonzero(~np.isin(calibration, impossible))
    records = [tables.calibrations[row] for row in calibration[sound].tolist()]
    found = camera_flaws(
        tables.rawpixel_from_camera[calibration[sound]],
        tables.ego_from_sensor[calibration[sound]],
        image_hw[sound],
        [record.camera_distortion for record in records],
    )
    problems: dict[int, Problem] = {}
    doubtful: dict[str, list[str]] = {}
    for flaw in found:
        token = records[flaw.camera].token
        problem = problem_of(flaw.reason, folder, CalibratedSensor, token, flaw.text)
        if flaw.is_sure:
            problems.setdefault(int(sound[flaw.camera]), problem)
        else:
            doubtful.setdefault(flaw.reason, []).append(problem.what)
    for reason, texts in doubtful.items():
        text = (
            f"{len(texts)} of {len(calibration)} calibrations look strange, the first: {texts[0]}"
        )
        warnings.append(Problem(reason, text))
    return setups, problems


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
            return f"records '{one}' and '{other}' of {_place(folder, EgoPose)}"

        for step, problem in step_flaws(elapsed_s, moved_m, name, longest_s).items():
            yield int(scene[first[step]]), problem


def _no_poses(folder: Path, tables: JoinedTables) -> Iterable[tuple[int, Problem]]:
    for row in np.flatnonzero(np.diff(tables.track_start) == 0).tolist():
        what = f"scene '{tables.scenes[row].token}' has no record in {_place(folder, SampleData)}"
        yield row, Problem("scene without poses", what)


def _far_images(
    folder: Path,
    tables: JoinedTables,
    images: NDArray[np.int64],
    time_s: FloatArray,
    global_from_ego: FloatArray,
) -> dict[int, Problem]:
    """Images that were not taken where and when their samples are, by frame."""
    sample, camera = np.nonzero(images >= 0)
    frames = images[sample, camera]
    elapsed_s = tables.frames.time_us[frames] / 1e6 - time_s[sample]
    moved_m = np.linalg.norm(
        tables.global_from_ego[frames, :3, 3] - global_from_ego[sample, :3, 3], axis=-1
    )

    def name(row: int) -> str:
        token = tables.frames.pose_token[frames[row]]
        return (
            f"record '{token}' of {_place(folder, EgoPose)} and the pose of sample "
            f"'{tables.samples[sample[row]].token}'"
        )

    flaws = step_flaws(elapsed_s, moved_m, name)
    return {int(frames[row]): problem for row, problem in flaws.items()}


def _astray_images(
    folder: Path, tables: JoinedTables, tracks: Tracks, images: NDArray[np.int64]
) -> dict[int, Problem]:
    """Images whose poses contradict the track of their scene, by frame."""
    sample, camera = np.nonzero(images >= 0)
    frames = images[sample, camera]
    found = astray(
        tracks,
        tables.sample_scene[sample],
        tables.frames.time_us[frames] / 1e6,
        tables.global_from_ego[frames],
    )
    return {
        int(frames[row]): problem_of(
            "image off the path", folder, EgoPose, tables.frames.pose_token[frames[row]], text
        )
        for row, text in found.items()
    }


def _late_images(
    tables: JoinedTables, images: NDArray[np.int64], time_s: FloatArray
) -> list[Problem]:
    """Of images that are far in time from their samples, though a car may be there by then."""
    sample, camera = np.nonzero(images >= 0)
    frames = images[sample, camera]
    away_s = np.abs(tables.frames.time_us[frames] / 1e6 - time_s[sample])
    late = np.flatnonzero((away_s > _LATE_S) & (away_s <= MAX_STEP_S))
    if not len(late):
        return []
    row = late[np.argmax(away_s[late])]
    text = (
        f"{len(late)} of {len(frames)} keyframe images are more than {_LATE_S:g} s from their "
        f"samples in time, '{tables.frames.filename[frames[row]]}' by {away_s[row]:.2g} s"
    )
    return [Problem("image at another time", text)]


def _place(folder: Path, record_type: type[Record]) -> str:
    return f"{folder.name}/{table_path(folder, record_type).name}"
