import json
from pathlib import Path

import pytest
from tiny_tables import VERSION

from lss_core.data.samples import load_index, rows_of_split
from lss_core.data.splits import official_scenes, scenes_of_split
from lss_core.errors import DataError


def test_official_sizes() -> None:
    assert len(official_scenes("v1.0-trainval", "train")) == 700
    assert len(official_scenes("v1.0-trainval", "val")) == 150
    assert len(official_scenes("v1.0-test", "test")) == 150
    assert len(official_scenes("v1.0-mini", "train")) == 8
    assert official_scenes("v1.0-mini", "val") == ("scene-0103", "scene-0916")


def test_train_and_val_share_nothing() -> None:
    for version in ("v1.0-trainval", "v1.0-mini", "v1.02-train"):
        train, val = (official_scenes(version, split) for split in ("train", "val"))
        assert not set(train) & set(val)


def test_mini_names_are_the_same_lists() -> None:
    for split in ("train", "val"):
        assert official_scenes("v1.0-mini", split) == official_scenes("v1.0-mini", f"mini_{split}")


@pytest.mark.parametrize(
    ("version", "split", "known"),
    [
        ("v1.0-trainval", "vall", "train, val"),
        ("v1.0-trainval", "test", "train, val"),
        ("v1.0-test", "val", "test"),
        ("v1.0-mini", "test", "mini_train, mini_val"),
    ],
)
def test_unknown_split_names_the_known(version: str, split: str, known: str) -> None:
    with pytest.raises(DataError, match=f"'{split}'.*known are {known}"):
        official_scenes(version, split)


def test_splits_json_overrides(tmp_path: Path) -> None:
    (tmp_path / "splits.json").write_text(json.dumps({"train": ["b", "a"], "odd": []}))
    assert scenes_of_split(tmp_path, "train") == ("b", "a")
    assert scenes_of_split(tmp_path, "odd") == ()
    with pytest.raises(DataError, match="knows odd, train"):
        scenes_of_split(tmp_path, "val")


@pytest.mark.parametrize("text", ["[1, 2]", "{", '{"train": "scene-0001"}', '{"train": 5}', "\xff"])
def test_bad_splits_json_is_named(tmp_path: Path, text: str) -> None:
    (tmp_path / "splits.json").write_bytes(text.encode("latin-1"))
    with pytest.raises(DataError, match=r"splits\.json' must be a JSON object"):
        scenes_of_split(tmp_path, "train")


def test_rows_are_those_of_the_splits_scenes(tiny_root: Path) -> None:
    index = load_index(tiny_root, VERSION, ("CAM_FRONT",))
    for split, scenes in (("train", {"scene-0001", "scene-0002"}), ("val", {"scene-0003"})):
        rows = rows_of_split(index, tiny_root, VERSION, split)
        assert set(index.scene_name[index.sample_scene[rows]]) == scenes
        assert len(rows) == 17 * len(scenes)
        # In the order of scenes and times.
        assert sorted(rows, key=lambda r: (index.sample_scene[r], index.time_s[r])) == list(rows)


def test_split_without_scenes_in_the_data_is_refused(tiny_root: Path) -> None:
    index = load_index(tiny_root, VERSION, ("CAM_FRONT",))
    with pytest.raises(DataError, match="None of the 8 scenes of split 'train'"):
        rows_of_split(index, tiny_root, "v1.0-mini", "train")


def test_own_list_of_scenes_must_be_there(tiny_root: Path, tmp_path: Path) -> None:
    index = load_index(tiny_root, VERSION, ("CAM_FRONT",))
    (tmp_path / VERSION).mkdir()
    names = ["scene-0001", "scene-0007", "scene-0008", "scene-0008", "scene-0009"]
    (tmp_path / VERSION / "splits.json").write_text(json.dumps({"train": names}))
    with pytest.raises(DataError, match=r"3 of the 4 scenes .* 'train' .* is 'scene-0007'\."):
        rows_of_split(index, tmp_path, VERSION, "train")


def test_part_of_an_official_split_is_counted(
    tiny_root: Path, caplog: pytest.LogCaptureFixture
) -> None:
    index = load_index(tiny_root, VERSION, ("CAM_FRONT",))
    assert len(rows_of_split(index, tiny_root, VERSION, "val"))
    assert "Split 'val': 1 of 150 scenes are in the tables." in caplog.text
