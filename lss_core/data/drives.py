"""Scenes known by what the car drove in them: one drive under two names is seen by its poses.

A drive is remembered as a digest of its steps, each from one recorded place to the next one some
way ahead. A step belongs to a place and to how its poses lie there, so that two drives along one
lane share next to none, and no time, name or token is in it. Cars that stand make no step. The
digest keeps the steps whose hashes are the smallest: two scenes keep the same ones of what they
share, so that a part driven in both is seen, too, if it takes some seconds.
"""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lss_core.data.samples import SampleIndex

# Poses are as good as equal if they are to about a centimetre.
_CELL_M = 0.01
# Of no round speed: a step that is a whole number of poses would hang on the last bit.
_STEP_M = 0.437
_KEPT, _DIGITS = 64, 8
# By chance there is hardly one; at 20 poses a second some three seconds of motion.
_SHARED = 4
_DIGEST = re.compile(f"(?:[0-9a-f]{{{_DIGITS}}}){{0,{_KEPT}}}")
_FACTORS = np.array(
    [0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9, 0xD6E8FEB86659FD93],
    dtype=np.uint64,
)


@dataclass(frozen=True)
class KnownScene:
    """A scene as it can be met again, also in a copy of the data under other names.

    Attributes:
        name: As in the table of scenes.
        token: Its own there.
        digest: Of what was driven, up to 64 numbers of 8 hexadecimal digits; empty if not known, or
            if the car stands.

    Raises:
        ValueError: If the digest is none.
    """

    name: str
    token: str
    digest: str = ""

    def __post_init__(self) -> None:
        if not _DIGEST.fullmatch(self.digest):
            raise ValueError(f"the digest of scene '{self.name[:80]}' is none")


def know_scenes(index: SampleIndex, scenes: Iterable[int]) -> tuple[KnownScene, ...]:
    """Name, token and digest of some scenes of an index, in their order.

    Args:
        index: Of a data set.
        scenes: Rows of scenes in it.
    """
    return tuple(
        KnownScene(
            str(index.scene_name[scene]),
            str(index.scene_token[scene]),
            _digest(index.global_from_track[index.track(scene), :2, 3]),
        )
        for scene in map(int, scenes)
    )


def find_shared(
    ours: Sequence[KnownScene], theirs: Sequence[KnownScene]
) -> list[tuple[KnownScene, KnownScene]]:
    """Pairs of one of ours and one of theirs that are the same scene or share a drive.

    Args:
        ours: Some scenes.
        theirs: Others. Where they share a token, or at least four steps of their digests, two are
            a pair; names say nothing, since other data sets have the same ones.

    Returns:
        The pairs, in our order.
    """
    step, owner = _steps_of(ours)
    their_step, their_owner = _steps_of(theirs)
    order = np.argsort(their_step, kind="stable")
    their_step, their_owner = their_step[order], their_owner[order]
    first = np.searchsorted(their_step, step)
    num = np.searchsorted(their_step, step, side="right") - first
    # Rows first, first + 1, ... first + num - 1 of each step.
    row = np.repeat(first - np.cumsum(num) + num, num) + np.arange(num.sum())
    pair = np.repeat(owner, num) * len(theirs) + their_owner[row]
    pairs, shared = np.unique(pair, return_counts=True)
    found = {divmod(number, len(theirs)) for number in pairs[shared >= _SHARED].tolist()}
    row_of = {scene.token: number for number, scene in enumerate(theirs)}
    found |= {(row, row_of[it.token]) for row, it in enumerate(ours) if it.token in row_of}
    return [(ours[row], theirs[other]) for row, other in sorted(found)]


def _digest(xy_m: NDArray[np.float64]) -> str:
    """Of positions [P, 2] in `global`, in the order of time."""
    way_m = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(xy_m, axis=0), axis=1)))[: len(xy_m)]
    ahead = np.searchsorted(way_m, way_m + _STEP_M)
    here = np.flatnonzero(ahead < len(xy_m))
    ahead = ahead[here]
    # A car that stands and whose poses tremble gets nowhere.
    moves = np.linalg.norm(xy_m[ahead] - xy_m[here], axis=1) > 0.5 * _STEP_M
    ends_m = np.concatenate([xy_m[here[moves]], xy_m[ahead[moves]]], axis=1)
    cells = np.round(ends_m / _CELL_M).astype(np.int64).astype(np.uint64)
    mixed = (cells * _FACTORS).sum(axis=1, dtype=np.uint64)
    mixed = (mixed ^ (mixed >> np.uint64(29))) * _FACTORS[1]
    smallest = np.unique((mixed >> np.uint64(32)).astype(">u4"))[:_KEPT]
    digest: str = smallest.astype(">u4").tobytes().hex()
    return digest


def _steps_of(scenes: Sequence[KnownScene]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Steps of all digests, and which scene each is of."""
    steps = np.frombuffer(bytes.fromhex("".join(scene.digest for scene in scenes)), dtype=">u4")
    num = [len(scene.digest) // _DIGITS for scene in scenes]
    return steps.astype(np.int64), np.repeat(np.arange(len(scenes)), num)
