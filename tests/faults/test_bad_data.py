"""Bad inputs, one by one: each is handled as documented or ends in one sentence that names it."""

import itertools
import json
import os
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
import tally
from bad_data import (
    BESIDE,
    CAMS,
    NUM_WITH_FUTURE,
    OUTCOME,
    TRAIN,
    Case,
    check,
    config,
    spoilt_copy,
    use,
)
from bad_files import IMAGES, SWEEPS
from bad_records import CALIBRATIONS, POSES
from bad_tables import NAMES, OUTSIDE, SPLITS, TABLE_CASES
from tiny_tables import VERSION, write_tiny

CASES = [*IMAGES, *SWEEPS, *CALIBRATIONS, *POSES, *TABLE_CASES, *SPLITS, *NAMES]
_opened: list[str] = []


@pytest.fixture(scope="session")
def sound(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The data set before it is spoilt; beside it lies what nobody may open."""
    root = tmp_path_factory.mktemp("bad") / "data"
    write_tiny(root, (TRAIN, BESIDE), cameras=CAMS, image_hw=(36, 64))
    splits = {"train": [TRAIN.name, BESIDE.name], "val": ["scene-0003"]}
    (root / VERSION / "splits.json").write_text(json.dumps(splits))
    return root


@pytest.fixture(scope="session")
def _watch() -> None:
    """Note what is opened, by whichever library."""

    def note(event: str, arguments: tuple[object, ...]) -> None:
        if event == "open" and isinstance(arguments[0], str | bytes):
            _opened.append(os.fsdecode(arguments[0]))

    sys.addaudithook(note)


@pytest.fixture
def opened(_watch: None) -> Iterator[list[str]]:
    """Paths that were opened during the test."""
    _opened.clear()
    yield _opened
    _opened.clear()


def test_there_are_enough_and_no_two_alike() -> None:
    names = [str(case) for case in CASES]
    assert len(set(names)) == len(names) >= 200


def test_nothing_is_wrong_with_it_before(sound: Path, opened: list[str]) -> None:
    for lidar, skip_bad in itertools.product((0, 1), (False, True)):
        used = use(config(sound, skip_bad, lidar))
        assert (used.sentence, len(used.tokens), used.left_out) == (None, NUM_WITH_FUTURE, ())
    # What is opened does not go unnoticed.
    for name in (f"{CAMS[1]}/scene-0001-01.jpg", "LIDAR_TOP/scene-0001-005.pcd.bin"):
        assert any(path.endswith(name) for path in opened)


@pytest.mark.parametrize("case", CASES, ids=str)
def test_bad_input(
    case: Case,
    sound: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    opened: list[str],
) -> None:
    monkeypatch.setenv("SHOOT_CACHE", str(tmp_path / "cache"))
    root = spoilt_copy(sound, case, tmp_path / "data")
    outside = tmp_path / OUTSIDE
    outside.mkdir()
    (outside / "image.jpg").write_bytes(
        (sound / "samples" / CAMS[0] / "scene-0002-01.jpg").read_bytes()
    )
    opened.clear()
    with tally.throw(f"bad data: {case.kind}", OUTCOME):
        check(case, root)
        strange = [
            name
            for name in opened
            if OUTSIDE in name or name.startswith(("/etc/passwd", "/dev/zero"))
        ]
        assert not strange
    shutil.rmtree(root)


def link(root: Path, target: Path, below: str = "") -> Path:
    """A data set of which a part lies elsewhere, as users with two disks have it."""
    if not below:
        target.symlink_to(root)
        return target
    elsewhere = target.parent / "other disk"
    (root / below).rename(elsewhere)
    (root / below).symlink_to(elsewhere)
    return root


@pytest.mark.parametrize(
    "name",
    [
        "with spaces",
        "ünïcode 画像 🚗",
        "quo'te\"s",
        "$HOME",
        "%s {0}",
        "a\nb",
        "-rf",
        "..data",
        "\udc80",
    ],
)
@pytest.mark.parametrize("lidar", [0, 1])
def test_paths_may_be_anything(name: str, lidar: int, sound: Path, tmp_path: Path) -> None:
    with tally.throw("bad data: paths", OUTCOME):
        root = spoilt_copy(sound, Case("paths", name, lambda _: None, None), tmp_path / name)
        used = use(config(root, lidar=lidar))
        assert (used.sentence, len(used.tokens)) == (None, NUM_WITH_FUTURE)
        (root / "samples" / CAMS[0] / "scene-0001-01.jpg").unlink()
        (root / "samples" / "LIDAR_TOP" / "scene-0001-005.pcd.bin").unlink()
        sentence = use(config(root, lidar=lidar)).sentence
        assert sentence is not None
        assert "scene-0001-0" in sentence


@pytest.mark.parametrize("below", ["", "samples", f"samples/{CAMS[0]}", VERSION])
def test_links_that_users_make_are_followed(below: str, sound: Path, tmp_path: Path) -> None:
    with tally.throw("bad data: paths", OUTCOME):
        root = spoilt_copy(sound, Case("paths", below, lambda _: None, None), tmp_path / "data")
        used = use(config(link(root, tmp_path / "link", below)))
        assert (used.sentence, len(used.tokens)) == (None, NUM_WITH_FUTURE)
