"""What README and docs say exists, exists; what they tell to type is understood."""

import importlib
import re
import shlex
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import tyro
from PIL import Image

import shoot
from lss_core.data.samples import load_index

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

ROOT = Path(__file__).parents[1]
PAGES = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").glob("**/*.md")])
HEADINGS = [
    "Two commands",
    "What the table says",
    "On nuScenes",
    "On your own cameras",
    "Commands",
    "Limits",
    "Links",
]
BLOCK = re.compile(r"^```(\w*)\n(.*?)^```", re.MULTILINE | re.DOTALL)


def commands() -> list[tuple[str, list[str]]]:
    """(command, its arguments) of every line in a shell block that calls one of ours."""
    found = []
    for page in PAGES:
        for language, text in BLOCK.findall(page.read_text(encoding="utf-8")):
            if language not in ("", "bash"):
                continue
            for line in text.replace("\\\n", " ").splitlines():
                words = shlex.split(line, comments=True) if "shoot-" in line else []
                names = [Path(word).name for word in words]
                place = next((i for i, name in enumerate(names) if name.startswith("shoot-")), None)
                if place is not None and (place == 0 or words[0] == "torchrun"):
                    found.append((names[place], words[place + 1 :]))
    return found


def test_pages_are_found() -> None:
    assert {"README.md", "CONTRIBUTING.md", "paper_map.md", "data.md"} <= {p.name for p in PAGES}
    assert {"shoot-fit-templates", "shoot-train", "shoot-evaluate", "shoot-render"} <= {
        name for name, _ in commands()
    }


def headings(text: str) -> list[str]:
    return re.findall(r"^#+ (.+)$", BLOCK.sub("", text), re.MULTILINE)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_links_lead_somewhere(page: Path) -> None:
    text = BLOCK.sub("", page.read_text(encoding="utf-8"))
    targets = re.findall(r"\]\(([^)\s]+)\)", text)
    local = [t for t in targets if not t.startswith(("http://", "https://"))]
    assert [t for t in local if not leads_somewhere(page, t)] == []


def leads_somewhere(page: Path, target: str) -> bool:
    """Whether the file is there, and in a page the heading, as code hosts make anchors of them."""
    name, _, anchor = target.partition("#")
    file = page.parent / name if name else page
    if not anchor or file.suffix != ".md":
        return file.exists()
    anchors = [
        re.sub(r"[^\w\- ]", "", h.lower()).replace(" ", "-") for h in headings(file.read_text())
    ]
    return anchor in anchors


def test_the_readme_is_short_and_in_order() -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    assert len(text.splitlines()) <= 120
    title, *parts = headings(text)
    assert parts == HEADINGS
    # One sentence, the picture, and only then the first heading.
    opening = text.split("\n## ")[0].split("\n\n")
    assert opening[0] == f"# {title}"
    assert opening[1].count(". ") == 0
    assert opening[2].startswith("![")


def test_short_results_repeat_rows_of_the_full_ones() -> None:
    """Rows that no script writes stand on a full page, too, to the letter."""
    made = re.compile(r"<!-- ([\w-]+) -->.*?<!-- /\1 -->", re.DOTALL)
    short, *full = ROOT / "docs" / "results.md", *(ROOT / "docs" / "results").glob("*.md")
    known = {line for page in full for line in page.read_text(encoding="utf-8").splitlines()}
    rows = [
        line
        for line in made.sub("", short.read_text(encoding="utf-8")).splitlines()
        if line.startswith("| ")
    ]
    assert len(rows) > 4
    assert [row for row in rows if row not in known] == []


@pytest.mark.parametrize(("command", "arguments"), commands())
def test_commands_are_understood(
    command: str, arguments: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    scripts = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["scripts"]
    module = importlib.import_module(f"shoot.cli.{scripts[command].split(':')[1]}")
    parsed: list[Any] = []

    def parse_only(config_type: Any, function: object, description: str) -> None:
        parsed.append(tyro.cli(config_type, args=arguments))

    monkeypatch.setattr(module, "run", parse_only)
    module.main()
    assert len(parsed) == 1


def python_block(page: Path) -> str:
    (code,) = [b for language, b in BLOCK.findall(page.read_text("utf-8")) if language == "python"]
    return code


def test_the_example_prints_what_its_page_says(capsys: pytest.CaptureFixture[str]) -> None:
    page = ROOT / "docs" / "use.md"
    exec(compile(python_block(page), "use.md", "exec"), {})
    promised = re.search(r"This prints `([^`]+)`", page.read_text(encoding="utf-8"))
    assert promised is not None
    assert capsys.readouterr().out.strip() == promised.group(1)


def test_the_names_offered_are_those_of_the_package() -> None:
    rows = re.findall(r"^\| `(\w+)` \|", (ROOT / "docs" / "use.md").read_text(), re.MULTILINE)
    assert sorted(rows) == sorted(shoot.__all__)


def test_recordings_become_a_data_set_as_the_readme_says(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    Image.new("RGB", (1280, 720)).save("image.jpg")
    poses = np.tile(np.eye(4), (13, 1, 1))
    poses[:, 0, 3] = 3.0 * np.arange(13)
    one = {
        "time_s": 0.5 * np.arange(13),
        "global_from_ego": poses,
        "intrinsics": [[700.0, 0.0, 640.0], [0.0, 700.0, 360.0], [0.0, 0.0, 1.0]],
        "ego_from_camera": [[0, 0, 1, 1.5], [-1, 0, 0, 0], [0, -1, 0, 1.4], [0, 0, 0, 1]],
        "images": [(0.5, "image.jpg"), (1.0, "image.jpg")],
    }
    drives = [SimpleNamespace(name=name, **one) for name in ("monday", "tuesday")]
    exec(compile(python_block(ROOT / "README.md"), "README.md", "exec"), {"drives": drives})
    index = load_index("data/mine", "v1.0-trainval", ("FRONT",))
    assert index.scene_name.tolist() == ["monday", "tuesday"]
    assert index.has_camera.tolist() == 4 * [[True]]


@pytest.mark.parametrize(
    "page",
    [page for page in PAGES if page.name != "CHANGELOG.md"],  # which tells of what was
    ids=lambda page: page.relative_to(ROOT).as_posix(),
)
def test_names_and_files_in_pages_exist(page: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # Exported planners have a copy of it beside them.
    monkeypatch.syspath_prepend(ROOT / "shoot" / "export")
    blocks = BLOCK.findall(page.read_text(encoding="utf-8"))
    imports = "\n".join(
        line
        for language, block in blocks
        if language == "python"
        for line in block.splitlines()
        if line.startswith(("import ", "from "))
    )
    exec(compile(imports, page.name, "exec"), {})
    sys.modules.pop("numpy_inputs", None)
    code = " ".join(re.findall(r"`([^`\n]+)`", BLOCK.sub("", page.read_text(encoding="utf-8"))))
    rooms = "lss_core|shoot|scripts|tests"
    files = re.findall(rf"(?<![\w./-])((?:{rooms})/[\w./-]+\.(?:py|sh))\b", code)
    assert [file for file in files if not (ROOT / file).exists()] == []
    for name in re.findall(r"(?<![\w./-])((?:lss_core|shoot)(?:\.[a-zA-Z]\w*)+)", code):
        assert resolve(name) is not None, name


def test_the_paper_map_points_to_things_that_exist() -> None:
    text = (ROOT / "docs" / "paper_map.md").read_text(encoding="utf-8")
    names = re.findall(r"`((?:lss_core|shoot)\.[\w.]+)`", text)
    tests = re.findall(r"`(tests/[\w/]+\.py)(?:::(\w+))?`", text)
    assert len(names) > 20
    assert len(tests) > 20
    for name in names:
        assert resolve(name) is not None, name
    for file, test in tests:
        source = (ROOT / file).read_text(encoding="utf-8")
        assert not test or re.search(rf"def {test}\(", source), f"{file}::{test}"


def resolve(name: str) -> object:
    """The object behind a dotted name: the longest module of it, then attributes."""
    parts = name.split(".")
    for end in range(len(parts), 0, -1):
        try:
            found: object = importlib.import_module(".".join(parts[:end]))
        except ModuleNotFoundError:
            continue
        for part in parts[end:]:
            found = getattr(found, part)
        return found
    raise AssertionError(f"no module of {name}")
