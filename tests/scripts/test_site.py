"""The documentation as a site: built without a warning, every public name on it, nobody asked."""

import ast
import os
import re
import subprocess
import sys
import zlib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
pytestmark = pytest.mark.full


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("site")
    building = subprocess.run(
        [Path(sys.executable).parent / "mkdocs", "build", "--strict", "--site-dir", folder],
        cwd=ROOT,
        env={**os.environ, "NO_MKDOCS_2_WARNING": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert building.returncode == 0, building.stderr[-3000:]
    assert "WARNING" not in building.stderr
    return folder


def public_names() -> set[str]:
    """Functions and classes that no underscore hides, with the module they are written in."""
    names = set()
    for path in [*(ROOT / "shoot").rglob("*.py"), *(ROOT / "lss_core").rglob("*.py")]:
        module = ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
        if "__main__" in module:
            continue
        names |= {
            f"{module}.{node.name}"
            for node in ast.parse(path.read_text(encoding="utf-8")).body
            if isinstance(node, ast.FunctionDef | ast.ClassDef) and not node.name.startswith("_")
        }
    return names


def test_every_public_name_has_its_place(site: Path) -> None:
    inventory = (site / "objects.inv").read_bytes().split(b"\n", 4)[4]
    listed = {line.split(" ")[0] for line in zlib.decompress(inventory).decode().splitlines()}
    names = public_names()
    assert len(names) > 500
    assert names - listed == set()


def test_pages_ask_nobody(site: Path) -> None:
    asks = re.compile(r"<(?:script|link|img|iframe)[^>]+(?:src|href)=.?https?://[^\s>]+")
    found = [ask for page in site.rglob("*.html") for ask in asks.findall(page.read_text("utf-8"))]
    assert found == []


def test_links_to_sources_lead_to_their_pages(site: Path) -> None:
    tour = (site / "tour" / "index.html").read_text(encoding="utf-8")
    assert 'href="../code/shoot/planner/scores/"' in tour
    assert "tour.md" not in tour
