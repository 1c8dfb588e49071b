"""What README and docs say exists, exists; what they tell to type is understood."""

import importlib
import re
import shlex
import sys
from pathlib import Path
from typing import Any

import pytest
import tyro

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

ROOT = Path(__file__).parents[1]
PAGES = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").glob("*.md")])
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


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_somewhere(page: Path) -> None:
    text = BLOCK.sub("", page.read_text(encoding="utf-8"))
    targets = re.findall(r"\]\(([^)\s]+)\)", text)
    local = [t for t in targets if not t.startswith(("http://", "https://", "#"))]
    assert [t for t in local if not (page.parent / t.split("#")[0]).exists()] == []


@pytest.mark.parametrize(("command", "arguments"), commands())
def test_commands_are_understood(
    command: str, arguments: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    scripts = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["scripts"]
    module = importlib.import_module(scripts[command].split(":")[0])
    parsed: list[Any] = []

    def parse_only(config_type: Any, function: object, description: str) -> None:
        parsed.append(tyro.cli(config_type, args=arguments))

    monkeypatch.setattr(module, "run", parse_only)
    module.main()
    assert len(parsed) == 1


def test_the_example_prints_what_the_readme_says(capsys: pytest.CaptureFixture[str]) -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    (code,) = [body for language, body in BLOCK.findall(text) if language == "python"]
    exec(compile(code, "README.md", "exec"), {})
    promised = re.search(r"This prints `([^`]+)`", text)
    assert promised is not None
    assert capsys.readouterr().out.strip() == promised.group(1)


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
