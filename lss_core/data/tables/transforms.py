"""Mountings, intrinsics and ego poses of records: matrices, and what is wrong with those of none.

A matrix that cannot be used is the identity and has a problem; nothing here ends at one bad record.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from lss_core.data.tables.by_token import ByToken
from lss_core.data.tables.problems import Problem, intrinsics_flaw, problem_of, transform_flaws
from lss_core.data.tables.reading import CalibratedSensor, EgoPose, SampleData, read_pieces
from lss_core.geometry import FloatArray, rigid_from_quaternion


def mountings(
    folder: Path, calibrations: list[CalibratedSensor], used: NDArray[np.int64]
) -> tuple[FloatArray, dict[int, Problem]]:
    """[K, 4, 4] of those calibrations that are used; zero for others, which may hold anything."""
    matrices = np.zeros((len(calibrations), 4, 4))
    if not len(used):
        return matrices, {}
    matrices[used], flaws = _possible_transforms(
        np.asarray([calibrations[row].translation for row in used]),
        np.asarray([calibrations[row].rotation for row in used]),
        is_mounting=True,
    )
    return matrices, {
        int(used[row]): _bad(folder, calibrations[used[row]], flaw) for row, flaw in flaws.items()
    }


def intrinsics(
    folder: Path, calibrations: list[CalibratedSensor], used: NDArray[np.int64]
) -> tuple[FloatArray, dict[int, Problem]]:
    """[K, 3, 3] of those calibrations that are used; zero for others."""
    matrices, problems = np.zeros((len(calibrations), 3, 3)), {}
    for row in used.tolist():
        matrix = calibrations[row].camera_intrinsic or []
        flaw = intrinsics_flaw(matrix)
        matrices[row] = np.eye(3) if flaw else matrix
        if flaw:
            problems[row] = _bad(folder, calibrations[row], flaw)
    return matrices, problems


def _bad(folder: Path, record: CalibratedSensor, flaw: str) -> Problem:
    return problem_of("impossible calibration", folder, CalibratedSensor, record.token, flaw)


def ego_poses(folder: Path, tokens: list[str]) -> tuple[FloatArray, dict[int, Problem]]:
    """[F, 4, 4] ego poses of frames, by their tokens."""
    slot: dict[str, int] = {}
    slots = np.asarray([slot.setdefault(token, len(slot)) for token in tokens], dtype=np.int64)
    translation_m, quaternion = np.zeros((len(slot), 3)), np.zeros((len(slot), 4))
    found = np.zeros(len(slot), dtype=bool)
    for piece in read_pieces(folder, EgoPose):
        own = [record for record in piece if record.token in slot]
        if own:
            rows = [slot[record.token] for record in own]
            translation_m[rows] = [record.translation for record in own]
            quaternion[rows] = [record.rotation for record in own]
            found[rows] = True
    names = list(slot)
    if not found.all():
        # Nothing is known by any token: this one is named as missing.
        ByToken[int](folder, EgoPose, SampleData, ())[names[int(found.argmin())]]
    poses, flaws = _possible_transforms(translation_m, quaternion, is_mounting=False)
    problems = {}
    for frame in np.flatnonzero(np.isin(slots, list(flaws))).tolist():
        token, flaw = names[slots[frame]], flaws[int(slots[frame])]
        problems[frame] = problem_of("impossible pose", folder, EgoPose, token, flaw)
    return poses[slots], problems


def _possible_transforms(
    translation_m: FloatArray, quaternion: FloatArray, is_mounting: bool
) -> tuple[FloatArray, dict[int, str]]:
    """[R, 4, 4] transforms, the identity for what is none; and what is wrong with that."""
    flaws = transform_flaws(translation_m, quaternion, is_mounting)
    bad = flaws != ""
    matrices = rigid_from_quaternion(
        np.where(bad[:, None], 0.0, translation_m),
        np.where(bad[:, None], [1.0, 0.0, 0.0, 0.0], quaternion),
    )
    return matrices, {int(row): flaws[row] for row in np.flatnonzero(bad)}


def reordered(rotations: FloatArray) -> FloatArray:
    """Rotations [R, 3, 3] as they are if their quaternions were x, y, z, w, not w, x, y, z."""
    if not len(rotations):
        return rotations
    x, y, z, w = Rotation.from_matrix(rotations).as_quat().T
    return np.asarray(Rotation.from_quat(np.stack([w, x, y, z], axis=-1)).as_matrix())
