import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lss_core.data.tables.array_file import map_arrays, save_arrays

ARRAYS: dict[str, np.ndarray[Any, Any]] = {
    "texts": np.array([["a", "längst"], ["", "c"]]),
    "mask": np.array([True, False, True]),
    "nothing": np.zeros((0, 4, 4)),
    "whole": np.arange(7),
    "turned": np.arange(12.0).reshape(3, 4).T,
    "one": np.array(3.5),
}


@pytest.fixture
def path(tmp_path: Path) -> Path:
    save_arrays(tmp_path / "made" / "file.arrays", ARRAYS)
    return tmp_path / "made" / "file.arrays"


def test_there_and_back(path: Path) -> None:
    mapped = map_arrays(path)
    assert list(mapped) == list(ARRAYS)
    for name, array in ARRAYS.items():
        assert (mapped[name].dtype, mapped[name].shape) == (array.dtype, array.shape)
        np.testing.assert_array_equal(mapped[name], array)
        assert mapped[name].flags.aligned
        assert not mapped[name].flags.writeable


def test_no_array_at_all(tmp_path: Path) -> None:
    save_arrays(tmp_path / "file", {})
    assert map_arrays(tmp_path / "file") == {}


def test_same_arrays_same_bytes(path: Path, tmp_path: Path) -> None:
    save_arrays(tmp_path / "again", ARRAYS)
    assert (tmp_path / "again").read_bytes() == path.read_bytes()


def test_arrays_outlive_their_file_name(path: Path) -> None:
    mapped = map_arrays(path)
    save_arrays(path, {"whole": np.zeros(3)})
    np.testing.assert_array_equal(mapped["whole"], ARRAYS["whole"])
    path.unlink()
    np.testing.assert_array_equal(mapped["turned"], ARRAYS["turned"])


def test_every_single_change_of_an_array_is_noticed(path: Path) -> None:
    contents = path.read_bytes()
    place = contents.index(ARRAYS["whole"].tobytes())
    for byte in range(place, place + ARRAYS["whole"].nbytes):
        path.write_bytes(contents[:byte] + bytes([contents[byte] ^ 4]) + contents[byte + 1 :])
        with pytest.raises(ValueError, match="changed"):
            map_arrays(path)


def test_every_shorter_file_is_refused(path: Path) -> None:
    contents = path.read_bytes()
    for length in range(len(contents)):
        path.write_bytes(contents[:length])
        with pytest.raises(ValueError):  # noqa: PT011  (json's, mmap's, numpy's or ours)
            map_arrays(path)


@pytest.mark.parametrize("header", [[], {"a": 3}, {"a": {"dtype": "<f8"}}, "text", None])
def test_other_headers_are_refused(tmp_path: Path, header: object) -> None:
    text = json.dumps(header).encode()
    (tmp_path / "file").write_bytes(len(text).to_bytes(8, "little") + text)
    with pytest.raises(ValueError, match="header"):
        map_arrays(tmp_path / "file")


def test_no_objects_come_from_a_file(tmp_path: Path) -> None:
    entry = {"dtype": "|O", "shape": [1], "start": 0, "crc32": 0}
    text = json.dumps({"a": entry}).encode()
    (tmp_path / "file").write_bytes(len(text).to_bytes(8, "little") + text + bytes(200))
    with pytest.raises(ValueError, match="OBJECT"):
        map_arrays(tmp_path / "file")
