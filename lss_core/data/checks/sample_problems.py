"""All that is wrong with the samples of a data set, and what may be meant, as the index has it."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lss_core.data.checks.image_problems import (
    astray_images,
    bad_cameras,
    far_images,
    late_images,
    many_keyframes,
)
from lss_core.data.checks.scene_problems import scene_problems
from lss_core.data.tables.joins import JoinedTables
from lss_core.data.tables.problems import ProblemList
from lss_core.data.tables.tracks import Tracks
from lss_core.geometry import FloatArray


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
    warnings = many_keyframes(folder, tables)
    scene = np.zeros(len(tables.scenes), dtype=np.int64)
    tracks = _tracks(tables)
    for own, problem in scene_problems(folder, tables, tracks, warnings):
        scene[own] = scene[own] or problems.add(problem)
    images, lidar = tables.images, tables.lidar
    calibration = np.append(tables.frames.calibration, -1)  # that of the frame -1
    camera = np.zeros(images.shape, dtype=np.int64)
    problems.mark(camera, calibration[images], tables.intrinsics_problems)
    problems.mark(camera, calibration[images], tables.mounting_problems)
    problems.mark(camera, images, tables.pose_problems)
    problems.mark(camera, images, tables.frames.size_problems)
    setups, flaws = bad_cameras(folder, tables, warnings)
    problems.mark(camera, setups, flaws)
    # Where a scene has a problem, its samples' frames mean nothing that an image could be far from.
    near = np.where((scene == 0)[tables.sample_scene, None], images, -1)
    problems.mark(camera, near, far_images(folder, tables, near, time_s, global_from_ego))
    problems.mark(camera, near, astray_images(folder, tables, tracks, near))
    warnings += late_images(tables, near, time_s)
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


def _tracks(tables: JoinedTables) -> Tracks:
    counts = np.diff(tables.track_start)
    return Tracks(
        time_s=tables.frames.time_us[tables.track] / 1e6,
        scene=np.repeat(np.arange(len(counts)), counts),
        global_from_ego=tables.global_from_ego[tables.track],
    )
