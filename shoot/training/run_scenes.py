"""Which scenes a run has seen, kept with it: what they are compared with when it is used again."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import msgspec

from lss_core.data.drives import KnownScene, find_shared
from lss_core.data.tables.reading import decode_json
from lss_core.errors import DataError
from lss_core.files import write_atomically

TRAINED_ON = "The run was trained on"
FITTED_ON = "The templates were fitted on"
_FORMAT_VERSION = 1
# A hundred thousand scenes take some 60 MB.
_MAX_BYTES = 1 << 26


class _Row(msgspec.Struct):
    name: str
    token: str
    digest: str
    used_for: list[str]


class _File(msgspec.Struct):
    format_version: int
    scenes: list[_Row]


@dataclass(frozen=True)
class RunScenes:
    """The scenes of a run.

    Attributes:
        trained: Those with samples it was trained on.
        validated: Those with samples it was validated on.
        fitted: Those its templates were fitted on, as far as they are known.
    """

    trained: tuple[KnownScene, ...]
    validated: tuple[KnownScene, ...]
    fitted: tuple[KnownScene, ...]

    def save(self, path: Path) -> None:
        """Write them as JSON: each scene once, with what it was used for.

        Raises:
            OSError: If it cannot be written.
        """
        used_for: dict[KnownScene, list[str]] = {}
        for use, scenes in vars(self).items():
            for scene in scenes:
                used_for.setdefault(scene, []).append(use)
        rows = [vars(scene) | {"used_for": uses} for scene, uses in used_for.items()]
        text = json.dumps({"format_version": _FORMAT_VERSION, "scenes": rows}, indent=1)
        with write_atomically(path) as stream:
            stream.write((text + "\n").encode())

    @staticmethod
    def load(path: Path) -> "RunScenes | None":
        """Read what `save` wrote; None where there is no file, as in older runs.

        Raises:
            DataError: If the file cannot be read, or is none of these.
        """
        if not path.exists():
            return None
        try:
            if path.stat().st_size > _MAX_BYTES:
                raise ValueError(f"it is larger than {_MAX_BYTES >> 20} MB")
            stored: _File = decode_json(path.read_bytes(), _File)
            if stored.format_version != _FORMAT_VERSION:
                raise ValueError(f"its format is {stored.format_version}")
            scenes = [KnownScene(row.name, row.token, row.digest) for row in stored.scenes]
        except OSError as error:
            raise DataError(f"'{path}' cannot be read: {error.strerror}.") from error
        except (ValueError, RecursionError, msgspec.ValidationError) as error:
            raise DataError(f"'{path}' does not hold the scenes of a run: {error}.") from error

        def used_for(use: str) -> tuple[KnownScene, ...]:
            rows = zip(scenes, stored.scenes, strict=True)
            return tuple(scene for scene, row in rows if use in row.used_for)

        return RunScenes(used_for("trained"), used_for("validated"), used_for("fitted"))

    def check_resumes(self, begun: "RunScenes", folder: Path) -> None:
        """Check that a run goes on with the scenes it was begun with.

        Args:
            begun: Those it was begun with; under other names and tokens they are the same.
            folder: Of the run, for the message.

        Raises:
            DataError: If not.
        """
        for what, before, now in (
            ("training", begun.trained, self.trained),
            ("validation", begun.validated, self.validated),
        ):
            pairs = find_shared(now, before)
            new, gone = set(now), set(before)
            for ours, theirs in pairs:
                new.discard(ours)
                gone.discard(theirs)
            # Scenes that share a drive in part are pairs, too.
            if new or gone or len(set(now)) != len(set(before)):
                of_these = [f"{len(new)} are new{_example(new)}"] if new else []
                of_those = [f"{len(gone)} are gone{_example(gone)}"] if gone else []
                told = ", ".join(of_these + of_those) or f"{len(now)} for {len(before)}"
                raise DataError(
                    f"'{folder}' was begun with other {what} scenes: {told}; resume it with the "
                    "splits and the data that it was begun with, or begin a new run."
                )


def check_unseen(scored: Sequence[KnownScene], seen: Sequence[KnownScene], what: str) -> None:
    """Check that scenes to be scored are none of those that something was made from.

    Args:
        scored: Scenes to be scored.
        seen: Scenes it was made from; none if they are not known.
        what: What was made from them, and how, for the message.

    Raises:
        DataError: If they share a scene, or a drive under whatever names.
    """
    pairs = find_shared(scored, seen)
    if pairs:
        ours, theirs = pairs[0]
        known_as = f", by its poses '{theirs.name}'" if theirs.token != ours.token else ""
        raise DataError(
            f"{what} {len({one for one, _ in pairs})} of the scenes to be scored ('{ours.name}' is "
            f"one{known_as}), so a score would say little of new ones; score other scenes, or go "
            "on all the same with --allow-seen-scenes."
        )


def count_seen(
    scored: Sequence[KnownScene],
    trained: Sequence[KnownScene],
    fitted: Sequence[KnownScene] = (),
    allow: bool = False,
) -> int:
    """How many scenes to be scored a run has seen, if that is allowed.

    Args:
        scored: Scenes to be scored.
        trained: Scenes the run was trained on.
        fitted: Scenes its templates were fitted on.
        allow: Whether it may have seen any.

    Raises:
        DataError: If it has, and may not.
    """
    if not allow:
        check_unseen(scored, trained, TRAINED_ON)
        check_unseen(scored, fitted, FITTED_ON)
    return len({scene for scene, _ in find_shared(scored, (*trained, *fitted))})


def check_apart(
    held_out: Sequence[KnownScene], used: Sequence[KnownScene], held_out_split: str, split: str
) -> None:
    """Check that no two scenes of one data set, one of each split, are one drive.

    Args:
        held_out: Scenes that are to be new.
        used: Those that something is made from.
        held_out_split: Name of the split they are of.
        split: The same.

    Raises:
        DataError: If two are, which names both. What stands in both lists is not looked for.
    """
    pairs = [pair for pair in find_shared(held_out, used) if pair[0].token != pair[1].token]
    if pairs:
        ours, theirs = pairs[0]
        more = f", and {len(pairs) - 1} more pairs" if len(pairs) > 1 else ""
        raise DataError(
            f"Scene '{ours.name}' of split '{held_out_split}' and scene '{theirs.name}' of split "
            f"'{split}' are one drive, by their poses{more}; a result on them would be worth "
            "nothing: put them into one split, or leave one out."
        )


def _example(scenes: set[KnownScene]) -> str:
    named = sorted(scene.name or f"token {scene.token}" for scene in scenes)
    return f" ('{named[0]}' is one)"
