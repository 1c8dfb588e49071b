"""docs/tour.md opens files at the lines it says.

    python tests/test_tour.py

puts the lines right after code has moved.
"""

import ast
import re
from pathlib import Path

ROOT = Path(__file__).parents[1]
TOUR = ROOT / "docs" / "tour.md"
LINK = re.compile(r"\[`(?P<name>[\w.]+)`\]\(\.\./(?P<file>[\w/]+\.py)#L(?P<line>\d+)\)")
COMMAND = "python tests/test_tour.py"


def line_of(name: str, file: Path) -> int | None:
    """Of the `def` or `class` of a dotted name, the decorators above it left out."""
    body = ast.parse(file.read_text(encoding="utf-8")).body
    line = None
    for part in name.split("."):
        kinds = (ast.FunctionDef, ast.ClassDef)
        found = next((node for node in body if isinstance(node, kinds) and node.name == part), None)
        if found is None:
            return None
        body, line = found.body, found.lineno
    return line


def place_of(name: str, file: str) -> tuple[str, int]:
    """File and line of a name: in the file where it was, or else where it is now."""
    rooms = [path for room in ("lss_core", "shoot") for path in sorted((ROOT / room).rglob("*.py"))]
    for path in (ROOT / file, *rooms):
        line = line_of(name, path) if path.is_file() else None
        if line is not None:
            return path.relative_to(ROOT).as_posix(), line
    raise AssertionError(f"docs/tour.md stops at {name}, which is nowhere.")


def corrected(text: str) -> str:
    """The page with the files and lines that its names have now."""

    def place(link: re.Match[str]) -> str:
        file, line = place_of(link["name"], link["file"])
        return f"[`{link['name']}`](../{file}#L{line})"

    return LINK.sub(place, text)


def test_each_stop_is_where_the_tour_says() -> None:
    text = TOUR.read_text(encoding="utf-8")
    wrong = [
        f"{is_now.group()} instead of {said.group()}"
        for said, is_now in zip(LINK.finditer(text), LINK.finditer(corrected(text)), strict=True)
        if said.group() != is_now.group()
    ]
    assert wrong == [], f"`{COMMAND}` writes these into docs/tour.md"


def test_the_tour_has_ten_stops_each_to_open() -> None:
    parts = re.split(r"^## ", TOUR.read_text(encoding="utf-8"), flags=re.MULTILINE)[1:]
    stops = [part for part in parts if part[0].isdigit()]
    assert [int(stop.split(".")[0]) for stop in stops] == list(range(1, 11))
    assert all(re.search(r"^Open " + LINK.pattern, stop, re.MULTILINE) for stop in stops)
    # None that the pattern does not see, and so does not hold to its line.
    linked = sum(part.count(".py#") for part in parts)
    assert len(LINK.findall("".join(parts))) == linked


if __name__ == "__main__":
    TOUR.write_text(corrected(TOUR.read_text(encoding="utf-8")), encoding="utf-8")
