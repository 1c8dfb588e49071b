"""Which images have a problem: their calibration, their poses, or when they were taken."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lss_core.data.checks.calibration import camera_flaws
from lss_core.data.checks.image_poses import astray
from lss_core.data.tables.joins import JoinedTables
from lss_core.data.tables.problems import MAX_STEP_S, Problem, place_of, problem_of, step_flaws
from lss_core.data.tables.reading import CalibratedSensor, EgoPose, SampleData
from lss_core.data.tables.tracks import Tracks
from lss_core.geometry import FloatArray

# Images this far in time from their samples show another moment.
_LATE_S = 0.2


def many_keyframes(folder: Path, tables: JoinedTables) -> list[Problem]:
    """Of samples for which records of one sensor at several times claim to be the keyframe."""
    rows = np.unique(tables.frames.sample[tables.rivals])
    if not len(rows):
        return []
    first = tables.samples[int(rows[0])].token
    text = (
        f"{len(rows)} of {len(tables.samples)} samples, the first '{first}', have several keyframes"
        f" of one sensor at different times in {place_of(folder, SampleData)}; the nearest in time"
        " to the sample is taken: is is_key_frame true for all records?"
    )
    return [Problem("several keyframes", text)]


def bad_cameras(
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


def far_images(
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
            f"record '{token}' of {place_of(folder, EgoPose)} and the pose of sample "
            f"'{tables.samples[sample[row]].token}'"
        )

    flaws = step_flaws(elapsed_s, moved_m, name)
    return {int(frames[row]): problem for row, problem in flaws.items()}


def astray_images(
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


def late_images(
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
