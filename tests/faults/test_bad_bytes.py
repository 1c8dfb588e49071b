"""Bytes and values at random in tables, images and sweeps: never a traceback, never a loss."""

import json
import os
import shutil
from pathlib import Path
from typing import Any

import pytest
import tally
from bad_data import OUTCOME, check_sentence, config, image, sweep, use
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from test_bad_data import sound  # noqa: F401
from tiny_tables import VERSION, read_table, write_table

from lss_core.data.tables.reading import TABLES

EVERYDAY, FULL = 40, 2000
_ALLOWED = [HealthCheck.function_scoped_fixture, HealthCheck.too_slow]
everyday = settings(max_examples=EVERYDAY, suppress_health_check=_ALLOWED)
in_full = settings(max_examples=FULL, suppress_health_check=_ALLOWED)

VALUES = st.recursive(
    st.none()
    | st.booleans()
    | st.integers()
    | st.sampled_from([0, -1, 2**63, 2**64, 10**30, 10**400])
    | st.floats()
    | st.text(max_size=20)
    | st.sampled_from(["../x", "/etc/passwd", "\ud800", "\x00", "a" * 2000, "scene-0001"]),
    lambda inner: (
        st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=5), inner, max_size=3)
    ),
    max_leaves=6,
)
FIELDS = [
    ("calibrated_sensor", name)
    for name in ("token", "sensor_token", "translation", "rotation", "camera_intrinsic")
]
FIELDS += [("ego_pose", name) for name in ("token", "translation", "rotation")]
FIELDS += [("sample", name) for name in ("token", "timestamp", "scene_token")]
FIELDS += [("scene", name) for name in ("token", "name", "description", "log_token")]
FIELDS += [("log", "token"), ("log", "location"), ("sensor", "token"), ("sensor", "channel")]
FIELDS += [
    ("sample_data", name)
    for name in (
        "token", "sample_token", "ego_pose_token", "calibrated_sensor_token", "timestamp",
        "is_key_frame", "filename", "width", "height",
    )
]  # fmt: skip
NUMBERS = st.floats(width=32) | st.sampled_from([0.0, 1.0, -1.0, 1e-3, 1e4, 1e9])


@pytest.fixture
def spoilt(sound: Path, tmp_path: Path) -> Path:  # noqa: F811
    shutil.copytree(sound, tmp_path / "data")
    return tmp_path / "data"


def use_spoilt(root: Path, lidar: int = 0) -> None:
    """Without and with the flag: it ends in one sentence, or nothing is lost without a word."""
    os.environ["SHOOT_CACHE"] = str(root.parent / "cache")
    plain = use(config(root, lidar=lidar))
    skipping = use(config(root, skip_bad=True, lidar=lidar))
    assert not plain.left_out
    for used in (plain, skipping):
        if used.sentence is not None:
            check_sentence(used.sentence)
            assert (
                str(root) in used.sentence or ".json" in used.sentence or "train" in used.sentence
            )
    if plain.sentence is None:
        # What is listed then is damage that does not show when it is read.
        assert plain.tokens == skipping.tokens | {one.sample for one in skipping.left_out}


def put(root: Path, field: tuple[str, str], row: int, value: Any) -> None:
    table, name = field
    records = read_table(root, table)
    before = json.dumps(records)
    records[row % len(records)][name] = value
    write_table(root, table, records)
    try:
        with tally.throw("bad data: values at random", OUTCOME):
            use_spoilt(root)
    finally:
        (root / VERSION / f"{table}.json").write_text(before)
        shutil.rmtree(root.parent / "cache", ignore_errors=True)


def numbers(root: Path, field: tuple[str, str], row: int, values: list[float]) -> None:
    put(root, field, row, values)


def damage(path: Path, root: Path, cut: int, flips: list[tuple[int, int]], lidar: int) -> None:
    """Cut a file and change some of its bytes."""
    before = path.read_bytes()
    spoilt = bytearray(before[: max(0, len(before) - cut)])
    for place, value in flips:
        if spoilt:
            spoilt[place % len(spoilt)] = value
    path.write_bytes(bytes(spoilt))
    try:
        with tally.throw("bad data: bytes at random", OUTCOME):
            use_spoilt(root, lidar)
    finally:
        path.write_bytes(before)
        if path.suffix == ".json":
            shutil.rmtree(root.parent / "cache", ignore_errors=True)


def file_of(root: Path, kind: str) -> tuple[Path, int]:
    if kind in TABLES.values():
        return root / VERSION / f"{kind}.json", 0
    return {"splits": (root / VERSION / "splits.json", 0), "image": (image(root), 0),
            "sweep": (sweep(root), 1)}[kind]  # fmt: skip


_KINDS = st.sampled_from(["image", "sweep", "splits", *TABLES.values()])
_CUTS = st.sampled_from([0, 0, 0, 1, 2, 20]) | st.integers(0, 3000)
_FLIPS = st.lists(st.tuples(st.integers(0, 100_000), st.integers(0, 255)), max_size=8)
_TRIPLES = st.sampled_from([f for f in FIELDS if f[1] in ("translation", "rotation")])


@given(field=st.sampled_from(FIELDS), row=st.integers(0, 400), value=VALUES)
@everyday
def test_values_at_random(spoilt: Path, field: tuple[str, str], row: int, value: Any) -> None:
    put(spoilt, field, row, value)


@given(field=_TRIPLES, row=st.integers(0, 400), values=st.lists(NUMBERS, min_size=3, max_size=4))
@everyday
def test_numbers_at_random(
    spoilt: Path, field: tuple[str, str], row: int, values: list[float]
) -> None:
    numbers(spoilt, field, row, values)


@given(kind=_KINDS, cut=_CUTS, flips=_FLIPS)
@everyday
def test_bytes_at_random(spoilt: Path, kind: str, cut: int, flips: list[tuple[int, int]]) -> None:
    path, lidar = file_of(spoilt, kind)
    damage(path, spoilt, cut, flips, lidar)


@pytest.mark.full
@given(field=st.sampled_from(FIELDS), row=st.integers(0, 400), value=VALUES)
@in_full
def test_many_values_at_random(spoilt: Path, field: tuple[str, str], row: int, value: Any) -> None:
    put(spoilt, field, row, value)


@pytest.mark.full
@given(field=_TRIPLES, row=st.integers(0, 400), values=st.lists(NUMBERS, min_size=3, max_size=4))
@in_full
def test_many_numbers_at_random(
    spoilt: Path, field: tuple[str, str], row: int, values: list[float]
) -> None:
    numbers(spoilt, field, row, values)


@pytest.mark.full
@given(kind=_KINDS, cut=_CUTS, flips=_FLIPS)
@in_full
def test_many_bytes_at_random(
    spoilt: Path, kind: str, cut: int, flips: list[tuple[int, int]]
) -> None:
    path, lidar = file_of(spoilt, kind)
    damage(path, spoilt, cut, flips, lidar)
