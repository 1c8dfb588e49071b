import json
import math
from pathlib import Path
from typing import Any

import pytest

from lss_core.data.tables import reading as tables
from lss_core.data.tables.reading import EgoPose, Log, read_pieces, read_table
from lss_core.errors import DataError


def log(number: int) -> dict[str, Any]:
    return {"token": f"log-{number:03d}", "location": "here", "vehicle": "a },{ b"}


def write(folder: Path, name: str, text: str) -> Path:
    (folder / f"{name}.json").write_text(text)
    return folder


@pytest.fixture(params=[64, 1000, 1 << 18], ids=lambda size: f"pieces of {size}")
def _piece(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tables, "_PIECE_BYTES", request.param)


@pytest.mark.usefixtures("_piece")
@pytest.mark.parametrize("num", [0, 1, 2, 100])
@pytest.mark.parametrize("indent", [None, 0, 2])
def test_all_records_come_in_order(tmp_path: Path, num: int, indent: int | None) -> None:
    records = [log(number) for number in range(num)]
    write(tmp_path, "log", json.dumps(records, indent=indent) + "\n")
    assert [r.token for r in read_table(tmp_path, Log)] == [r["token"] for r in records]


@pytest.mark.usefixtures("_piece")
@pytest.mark.parametrize("between", ["},{", "} ,{", "}\n,\n{"])
def test_commas_may_stand_anywhere(tmp_path: Path, between: str) -> None:
    plain = [{"token": f"log-{number:03d}", "location": "here"} for number in range(100)]
    write(tmp_path, "log", json.dumps(plain).replace("}, {", between))
    assert len(read_table(tmp_path, Log)) == 100


@pytest.mark.usefixtures("_piece")
def test_a_cut_within_a_text_is_noticed(tmp_path: Path) -> None:
    # Were it taken for the end of a record, half of them would be lost.
    records = [{"token": "t" * 50, "location": '"},' * 40} for _ in range(50)]
    write(tmp_path, "log", json.dumps(records))
    assert [r.location for r in read_table(tmp_path, Log)] == ['"},' * 40] * 50


def test_long_tables_come_in_pieces(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tables, "_PIECE_BYTES", 1000)
    write(tmp_path, "log", json.dumps([log(n) | {"vehicle": "a"} for n in range(500)]))
    pieces = list(read_pieces(tmp_path, Log))
    assert max(len(piece) for piece in pieces) < 40
    assert sum(len(piece) for piece in pieces) == 500


@pytest.mark.usefixtures("_piece")
def test_whole_numbers_and_nan_are_numbers(tmp_path: Path) -> None:
    pose = {"token": "p", "translation": [1, 2, 3.5], "rotation": [1, 0, 0, 0]}
    lost = pose | {"translation": [math.nan, 0.0, 0.0]}
    write(tmp_path, "ego_pose", json.dumps([pose, lost, pose]))
    poses = read_table(tmp_path, EgoPose)
    assert [p.translation for p in (poses[0], poses[2])] == [(1.0, 2.0, 3.5)] * 2
    assert math.isnan(poses[1].translation[0])


@pytest.mark.usefixtures("_piece")
@pytest.mark.parametrize("contents", ["[not json]", "", "[", "[] []", "void", "\xff"])
def test_damaged_table_is_named(tmp_path: Path, contents: str) -> None:
    write(tmp_path, "log", contents)
    with pytest.raises(DataError, match=r"log\.json' is damaged after 0 or more records"):
        read_table(tmp_path, Log)


@pytest.mark.usefixtures("_piece")
def test_table_cut_off_is_damaged(tmp_path: Path) -> None:
    write(tmp_path, "log", json.dumps([log(number) for number in range(100)])[:-30])
    with pytest.raises(DataError, match=r"log\.json' is damaged after \d+ or more records"):
        read_table(tmp_path, Log)


@pytest.mark.usefixtures("_piece")
@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"location": 3}, r"Expected `str`, got `int` - at `\$\[70\]\.location`"),
        ({"token": None}, r"Expected `str`, got `null` - at `\$\[70\]\.token`"),
    ],
)
def test_wrong_type_names_table_record_and_field(
    tmp_path: Path, change: dict[str, Any], message: str
) -> None:
    records = [log(number) | {"vehicle": "a"} for number in range(100)]
    records[70] |= change
    write(tmp_path, "log", json.dumps(records))
    with pytest.raises(DataError, match=rf"log\.json' is not as it should be: {message}"):
        read_table(tmp_path, Log)


@pytest.mark.parametrize(
    ("contents", "message"),
    [
        ("{}", "Expected `array`, got `object`"),
        ("[3]", r"Expected `object`, got `int` - at `\$\[0\]`"),
        ('[{"token": "t"}]', r"missing required field `location` - at `\$\[0\]`"),
    ],
)
def test_other_contents_are_refused(tmp_path: Path, contents: str, message: str) -> None:
    write(tmp_path, "log", contents)
    with pytest.raises(DataError, match=message):
        read_table(tmp_path, Log)


def test_poses_have_three_and_four_numbers(tmp_path: Path) -> None:
    pose = {"token": "p", "translation": [1.0, 2.0], "rotation": [1.0, 0.0, 0.0, 0.0]}
    write(tmp_path, "ego_pose", json.dumps([pose]))
    with pytest.raises(DataError, match=r"length 3.*translation"):
        read_table(tmp_path, EgoPose)


def test_unreadable_table_is_named(tmp_path: Path) -> None:
    (tmp_path / "log.json").mkdir()
    with pytest.raises(DataError, match=r"log\.json' cannot be read"):
        read_table(tmp_path, Log)
