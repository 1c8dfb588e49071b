"""Texts of tables that become names of files, pages and pictures."""

import json
from pathlib import Path

import pytest
import tally
from bad_data import OUTCOME, rewrite
from html_fixture import HOSTILE, read_page
from test_bad_commands import complaint, evaluate, render, run  # noqa: F401
from tiny_tables import VERSION, read_table, write_table
from world_fixture import TinyRun

from lss_core.data.annotations.drivable import load_drivable_area
from lss_core.data.annotations.map_file import has_map, map_path
from lss_core.data.tables.file_names import is_plain, leads_astray
from lss_core.errors import DataError
from lss_core.legible import legible

ASTRAY = [
    "../../outside", "/outside/map", "a/b", "..", ".", "", "a\\b", "a\x00b", "a\nb", "\x1b[2J",
    "x" * 300, "../maps/expansion/here",
]  # fmt: skip
PLAIN = ["boston-seaport", "Palo Alto", "München, Süd", "横浜", "..a", "a..b", "-rf", "%2e%2e", "~"]


@pytest.mark.parametrize("location", ASTRAY)
def test_a_location_is_no_way_out(location: str, tmp_path: Path) -> None:
    with tally.throw("bad data: file names", OUTCOME):
        root = tmp_path / "data"
        (root / "maps" / "expansion").mkdir(parents=True)
        # Wherever it leads, there is a file of that name.
        for place in (tmp_path, root, root / "maps", root / "maps" / "expansion"):
            for name in ("outside.json", "here.json", ".json", "...json"):
                (place / name).write_text("{}")
        assert not is_plain(location)
        assert not has_map(root, location)
        with pytest.raises(DataError, match="location"):
            load_drivable_area(root, location)


@pytest.mark.parametrize("name", PLAIN)
def test_plain_names_are_followed(name: str, tmp_path: Path) -> None:
    assert is_plain(name)
    assert not leads_astray(f"samples/{name}/{name}.jpg")
    path = map_path(tmp_path, name)
    assert path.parent == tmp_path / "maps" / "expansion"
    assert not has_map(tmp_path, name)
    path.parent.mkdir(parents=True)
    path.write_text("{}")
    assert has_map(tmp_path, name)


def test_evaluation_does_not_follow_locations(run: TinyRun) -> None:  # noqa: F811
    with tally.throw("bad data: file names", OUTCOME):
        (run.root.parent / "secret.json").write_text("{}")
        (run.root / "maps" / "expansion").mkdir()
        (run.root / "maps" / "expansion" / "here.json").write_text("{}")
        change = ["../../../secret", "here"]
        rewrite("log", lambda rs: [r | {"location": change[n % 2]} for n, r in enumerate(rs)])(
            run.root
        )
        assert "location" in complaint(evaluate(run))


def rename_sample(root: Path, old: str, new: str) -> None:
    for table, field in (("sample", "token"), ("sample_data", "sample_token")):
        records = read_table(root, table)
        for record in records:
            if record[field] == old:
                record[field] = new
        write_table(root, table, records)


@pytest.mark.parametrize("token", ASTRAY)
def test_pictures_stay_in_their_folder(token: str, run: TinyRun) -> None:  # noqa: F811
    with tally.throw("bad data: file names", OUTCOME):
        rename_sample(run.root, "scene-0003-00", token)
        before = {path for path in run.root.parent.rglob("*") if path.suffix == ".png"}
        assert "sample" in complaint(render(run, "--num", 1))
        assert {path for path in run.root.parent.rglob("*") if path.suffix == ".png"} == before


def test_hostile_texts_on_page_and_pictures(run: TinyRun) -> None:  # noqa: F811
    """Names, descriptions and tokens that would be markup, mathematics or steer a terminal."""
    texts = [text.replace("\udc80", "") for text in HOSTILE]
    with tally.throw("bad data: file names", OUTCOME, times=len(texts)):
        scenes = read_table(run.root, "scene")
        for number, scene in enumerate(scenes):
            # Of each name there is one, so that splits can tell them apart.
            scene["name"] = f"{scene['name'][-4:]} {texts[number % len(texts)]}"
            scene["description"] = texts[(number + 3) % len(texts)]
        write_table(run.root, "scene", scenes)
        names = [scene["name"] for scene in scenes]
        splits = {
            "train": [n for n in names if n[:4] in ("0001", "0002", "0004", "0005")],
            "val": [n for n in names if n[:4] in ("0003", "0012", "0013")],
        }
        (run.root / VERSION / "splits.json").write_text(json.dumps(splits))
        for scene in ("scene-0003", "scene-0012", "scene-0013"):
            for number in range(5):
                rename_sample(run.root, f"{scene}-{number:02d}", f"{scene}-{number} <b>$")
        html = run.folder / "report.html"
        said = evaluate(run, "--html", html)
        assert said.status == 0, said.err
        page = read_page(html.read_text())
        assert not page.all("script", "iframe", "object", "b")
        assert not [node for node in page for name in node.attributes if name.startswith("on")]
        sizes = {"width", "height"}
        pictures = [node for node in page.all("img") if sizes <= set(node.attributes)]
        assert len(pictures) == len(page.all("img")) > 0
        shown = " ".join(page.text.split())
        for name in splits["val"]:
            assert " ".join(legible(name).split()) in shown


def test_pictures_of_hostile_texts(run: TinyRun) -> None:  # noqa: F811
    with tally.throw("bad data: file names", OUTCOME, times=3):
        texts = ["$\\frac{1}{$ and $5", "a" * 5000, "\x1b[2J nul\x00 \u202e 画像 <script>"]
        scenes = read_table(run.root, "scene")
        for number, scene in enumerate(scenes):
            scene["description"] = texts[number % 3]
        write_table(run.root, "scene", scenes)
        said = render(run, "--num", 3)
        assert said.status == 0, said.err
        assert len(list((run.folder / "pictures").glob("*.png"))) == 3
