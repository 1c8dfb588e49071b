"""The index comes from the cache while its tables stay as they are; what lacks is named."""

import json
import logging
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tiny_tables import KEYFRAMES_A_SCENE, VERSION, copy_tiny, read_table, write_table

from lss_core.config import CAMERAS
from lss_core.data.samples import SampleIndex, building, load_index
from lss_core.data.tables.array_file import save_arrays
from lss_core.data.tables.reading import TABLES
from lss_core.errors import DataError


def forbid_tables(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: Any) -> None:
        raise AssertionError("the tables were opened")

    monkeypatch.setattr(building, "join_tables", fail)


def test_second_load_reads_the_cache(
    tiny_copy: Path, own_cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = load_index(tiny_copy, VERSION, CAMERAS[:2])
    assert len(list(own_cache.glob("index-*.arrays"))) == 1
    forbid_tables(monkeypatch)
    second = load_index(str(tiny_copy), VERSION, list(CAMERAS[:2]))
    for f in fields(SampleIndex):
        np.testing.assert_array_equal(getattr(second, f.name), getattr(first, f.name))
    with pytest.raises(AssertionError, match="the tables were opened"):
        load_index(tiny_copy, VERSION, CAMERAS[:1])


def test_changed_table_is_read_anew(tiny_copy: Path, own_cache: Path) -> None:
    load_index(tiny_copy, VERSION, CAMERAS[:2])
    scenes = read_table(tiny_copy, "scene")
    scenes[0]["description"] = "Nade by hand"  # as long as before: only the time stamp tells
    write_table(tiny_copy, "scene", scenes)
    assert load_index(tiny_copy, VERSION, CAMERAS[:2]).scene_description[0] == "Nade by hand"


@pytest.mark.parametrize("damage", ["empty", "half", "text", "bit", "other"])
def test_damaged_cache_is_built_anew(
    tiny_copy: Path, own_cache: Path, caplog: pytest.LogCaptureFixture, damage: str
) -> None:
    first = load_index(tiny_copy, VERSION, CAMERAS[:2])
    (cache,) = own_cache.glob("index-*.arrays")
    whole = cache.read_bytes()
    if damage == "other":
        save_arrays(cache, {"cameras": np.zeros(3)})
    else:
        spoilt = {"empty": b"", "half": whole[: len(whole) // 2], "text": b"no"}
        # Where the poses of the last scene are.
        spoilt["bit"] = whole[:-100] + bytes([whole[-100] ^ 1]) + whole[-99:]
        # Another file of that name: the old one is still mapped by `first`.
        cache.unlink()
        cache.write_bytes(spoilt[damage])
    with caplog.at_level(logging.WARNING):
        again = load_index(tiny_copy, VERSION, CAMERAS[:2])
    assert "building it anew" in caplog.text
    np.testing.assert_array_equal(again.track_xy_m, first.track_xy_m)
    assert cache.read_bytes() == whole


def test_unwritable_cache_only_warns(
    tiny_copy: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    blocked = tmp_path / "a_file"
    blocked.write_text("no folder can be made here")
    monkeypatch.setenv("SHOOT_CACHE", str(blocked / "cache"))
    with caplog.at_level(logging.WARNING):
        index = load_index(tiny_copy, VERSION, CAMERAS[:2])
    assert "could not be cached" in caplog.text
    assert len(index.sample_token) == 2 * KEYFRAMES_A_SCENE


def test_cache_goes_to_the_users_cache_folder(
    tiny_copy: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("SHOOT_CACHE")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "xdg"))
    load_index(tiny_copy, VERSION, CAMERAS[:2])
    assert len(list((tmp_path / "xdg" / "shoot").glob("index-*.arrays"))) == 1


def test_missing_root(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"'.*nowhere' is not a folder"):
        load_index(tmp_path / "nowhere", VERSION, CAMERAS)


def test_missing_version_names_those_found(tiny_root: Path, tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"no version 'v1\.0-mini' in .*found v1\.0-trainval"):
        load_index(tiny_root, "v1.0-mini", CAMERAS)
    with pytest.raises(DataError, match="no version with tables"):
        load_index(tmp_path, "v1.0-mini", CAMERAS)


@pytest.mark.parametrize("table", sorted(TABLES.values()))
def test_missing_table_is_named(tiny_copy: Path, own_cache: Path, table: str) -> None:
    (tiny_copy / VERSION / f"{table}.json").unlink()
    with pytest.raises(DataError, match=f"lacks {table}.json"):
        load_index(tiny_copy, VERSION, CAMERAS[:2])


def test_other_tables_are_not_needed(tiny_copy: Path, own_cache: Path) -> None:
    for table in (tiny_copy / VERSION).glob("*.json"):
        if table.stem not in TABLES.values():
            table.unlink()
    assert len(load_index(tiny_copy, VERSION, CAMERAS[:2]).sample_token) == 2 * KEYFRAMES_A_SCENE


def test_nothing_can_be_written_to(tiny_copy: Path, own_cache: Path) -> None:
    # Neither to an index from the cache nor to one that was just made.
    for index in (load_index(tiny_copy, VERSION, CAMERAS[:2]) for _ in range(2)):
        with pytest.raises(ValueError, match="read-only"):
            index.track_xy_m[0] = 0.0


def test_copies_of_a_data_set_have_their_own_cache(
    tiny_copy: Path, tmp_path: Path, own_cache: Path
) -> None:
    copy = copy_tiny(tiny_copy, tmp_path / "copy")
    scenes = json.loads((copy / VERSION / "scene.json").read_text())
    scenes[0]["description"] = "A copy"
    write_table(copy, "scene", scenes)
    load_index(tiny_copy, VERSION, CAMERAS[:2])
    assert load_index(copy, VERSION, CAMERAS[:2]).scene_description[0] == "A copy"
    assert len(list(own_cache.glob("index-*.arrays"))) == 2
