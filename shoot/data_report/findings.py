"""What is to be said of a data set: what contradicts itself, may be meant, or is not there."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lss_core.data.samples import SampleIndex
from shoot.data_report.facts import (
    CameraFacts,
    DriveFacts,
    FileFacts,
    Finding,
    FutureFacts,
    LidarFacts,
)
from shoot.trajectories import HORIZON_S

_NAMED = 3


def index_findings(index: SampleIndex) -> Iterator[Finding]:
    """Every problem of the index, by kind: of scenes, images, lidar sweeps; then its warnings."""
    yield from _problems(index, index.scene_problem, "scenes")
    yield from _problems(index, index.camera_problem[index.has_camera], "images")
    yield from _problems(index, index.lidar_problem[index.lidar_path != ""], "lidar sweeps")
    for reason in dict.fromkeys(index.warning_reason.tolist()):
        texts = [str(text) for text in index.warning_text[index.warning_reason == reason]]
        yield Finding("warning", reason, "", tuple(texts[:_NAMED]), len(texts))


def _problems(index: SampleIndex, numbers: NDArray[np.int64], things: str) -> Iterator[Finding]:
    found = numbers[numbers > 0]
    reasons = index.problem_reason[found]
    for reason in dict.fromkeys(reasons.tolist()):
        own = found[reasons == reason]
        texts = [str(index.problem_text[number]) for number in dict.fromkeys(own.tolist())]
        where = f"{len(own)} of {len(numbers)} {things}"
        yield Finding("error", reason, where, tuple(texts[:_NAMED]), len(texts))


def file_findings(cameras: tuple[CameraFacts, ...], lidar: LidarFacts) -> Iterator[Finding]:
    """Files that are damaged or no files of these tables; sensors without any."""
    any_there = any(camera.files.num_there for camera in cameras)
    for camera in cameras:
        yield from _flaws(camera.files, f"images of {camera.channel}")
        if not camera.num_images:
            text = "the tables have no keyframe image of it"
            yield Finding("warning", "camera without images", camera.channel, (text,), 1)
        elif any_there and not camera.files.num_there:
            yield Finding("warning", "missing images", camera.channel, (_missing(camera.files),), 1)
        elif camera.files.num_there < camera.files.num_looked_at and any_there:
            yield Finding("note", "missing images", camera.channel, (_missing(camera.files),), 1)
    if not any_there and any(camera.files.num_looked_at for camera in cameras):
        text = "no image that was looked for is on disk: these are tables alone"
        yield Finding("note", "missing images", "all cameras", (text,), 1)
    yield from _flaws(lidar.files, "lidar sweeps")
    if lidar.files.num_there < lidar.files.num_looked_at:
        text = f"{_missing(lidar.files)}; planners that see cameras do without"
        yield Finding("note", "missing sweeps", "LIDAR_TOP", (text,), 1)


def _flaws(files: FileFacts, things: str) -> Iterator[Finding]:
    if files.flaws:
        where = f"{len(files.flaws)} of {files.num_looked_at} {things} that were looked at"
        yield Finding("error", "unusable files", where, files.flaws[:_NAMED], len(files.flaws))


def _missing(files: FileFacts) -> str:
    num_missing = files.num_looked_at - files.num_there
    return f"{num_missing} of {files.num_looked_at} files that were looked for are not on disk"


def use_findings(drives: DriveFacts, futures: FutureFacts, folder: Path) -> Iterator[Finding]:
    """Lists of scenes that are not there; and what the data set cannot be used for."""
    for split in drives.splits:
        if split.is_own and split.missing:
            num_missing = split.num_listed - split.num_scenes
            where = f"{num_missing} of {split.num_listed} in split '{split.name}' of splits.json"
            yield Finding("error", "scenes not in the tables", where, split.missing, num_missing)
    if not futures.num_labels:
        text = (
            f"no keyframe has {HORIZON_S:g} s of recorded future: nothing to train on or to score"
        )
        yield Finding("note", "no futures", "", (text,), 1)
    if not any(split.num_scenes for split in drives.splits):
        text = f"no split names a scene that is here; name them in {folder.name}/splits.json"
        yield Finding("note", "no splits", "", (text,), 1)
