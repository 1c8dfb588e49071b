"""The picture in docs/architecture.md is the contracts that lint-imports holds, line by line."""

import re
import sys
from pathlib import Path
from typing import Any

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

ROOT = Path(__file__).parents[1]


def contracts() -> dict[str, str]:
    """Name -> layers from above, of every contract of layers."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    all_of_them: list[dict[str, Any]] = settings["tool"]["importlinter"]["contracts"]
    return {c["name"]: " > ".join(c["layers"]) for c in all_of_them if c["type"] == "layers"}


def drawn() -> dict[str, str]:
    """The same as the page draws them."""
    page = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    after = page.split("## Who may import whom")[1]
    (picture, *_) = re.findall(r"^```\n(.*?)^```", after, re.MULTILINE | re.DOTALL)
    lines = (line.split(maxsplit=1) for line in picture.splitlines())
    return {name: layers.strip() for name, layers in lines}


def test_each_line_of_the_picture_is_a_contract() -> None:
    assert drawn() == contracts()


def test_every_room_is_named() -> None:
    page = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    rooms = {p.parent for top in ("shoot", "lss_core") for p in (ROOT / top).rglob("__init__.py")}
    unnamed = [str(room.relative_to(ROOT)) for room in rooms if f"{room.name}/" not in page]
    assert unnamed == []
