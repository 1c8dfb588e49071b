"""The tutorial runs from its first cell to its last, and what is kept of it is fit to be read."""

import ast
import importlib
import re
import sys
from base64 import b64decode, b64encode
from io import BytesIO
from pathlib import Path
from typing import Any

import nbformat
import numpy as np
import pytest
from nbclient.exceptions import CellExecutionError
from nbformat import NotebookNode
from nbformat.v4 import new_code_cell, new_notebook, new_output
from PIL import Image

ROOT = Path(__file__).parents[1]
TUTORIAL = ROOT / "docs" / "tutorial.ipynb"
CLAIMS = {
    "frustum": "a point is seen where it comes from",
    "depth-maps": "depths of a pixel sum to one",
    "outer-figure": "a lifted pixel sums to its context",
    "splat-cells": "six cameras are the sum of each alone",
    "cell-two-ways": "two ways to the sum of a cell",
    "all-cells-check": "and of all cells",
    "cost-map": "the pieces make the planner",
    "templates-figure": "the label is the nearest template",
    "boltzmann": "probabilities are those of Eq. 2, and sum to one",
    "waypoints-figure": "waypoints sum to a template",
    "gradient": "the gradient by hand",
    "one-step": "the label's probability rises",
}
PATH_OF_A_MACHINE = re.compile(r"(^|[\s'\"(=:])(/\w[\w.-]*/|[A-Z]:\\|~/)", re.MULTILINE)


@pytest.fixture
def script(monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.syspath_prepend(ROOT / "scripts")
    return importlib.import_module("tutorial")


@pytest.fixture(scope="module")
def kept() -> NotebookNode:
    return nbformat.read(TUTORIAL, as_version=4)


def code_cells(notebook: NotebookNode) -> list[NotebookNode]:
    return [cell for cell in notebook.cells if cell.cell_type == "code"]


def shown(notebook: NotebookNode) -> dict[str, list[list[str]]]:
    """What kinds of things each cell shows; what libraries say on stderr is theirs."""
    kinds = {}
    for cell in code_cells(notebook):
        outputs = [output for output in cell.outputs if output.get("name") != "stderr"]
        kinds[cell.id] = [sorted(output.get("data", ["text"])) for output in outputs]
    return kinds


@pytest.mark.full
def test_every_cell_runs_and_shows_what_is_kept(script: Any, kept: NotebookNode) -> None:
    assert shown(script.run_cells(TUTORIAL)) == shown(kept)


def test_a_cell_that_fails_ends_the_run_of_this_python(script: Any, tmp_path: Path) -> None:
    path = tmp_path / "two.ipynb"
    this = f"import sys; assert sys.executable == {sys.executable!r}, 'another Python'"
    cells = [new_code_cell(this), new_code_cell("assert 1 + 1 == 3, 'a wrong claim'")]
    nbformat.write(new_notebook(cells=cells), path)
    with pytest.raises(CellExecutionError, match="a wrong claim"):
        script.run_cells(path)


def test_pictures_keep_a_colour_that_is_rare(script: Any) -> None:
    ramp = np.indices((64, 64)).sum(axis=0).astype(np.uint8)
    pixels = np.stack([ramp, 128 - ramp, ramp // 2 + 60], axis=-1)
    pixels[10, 20] = 0, 250, 0
    stream = BytesIO()
    Image.fromarray(pixels).save(stream, "png")
    output = new_output("display_data", {"image/png": b64encode(stream.getvalue()).decode()})
    script.shrink_pictures(new_notebook(cells=[new_code_cell("", outputs=[output])]))
    image = Image.open(BytesIO(b64decode(output.data["image/png"])))
    assert image.mode == "P"
    gaps = np.abs(np.asarray(image.convert("RGB")).astype(int) - pixels)
    assert gaps.max() < 16


def test_claims_are_asserted(kept: NotebookNode) -> None:
    asserting = {
        cell.id
        for cell in code_cells(kept)
        if any(isinstance(node, ast.Assert) for node in ast.walk(ast.parse(cell.source)))
    }
    assert {cell: claim for cell, claim in CLAIMS.items() if cell not in asserting} == {}


def test_what_is_kept_is_one_run_without_an_error(kept: NotebookNode) -> None:
    cells = code_cells(kept)
    assert [cell.execution_count for cell in cells] == list(range(1, len(cells) + 1))
    outputs = [output for cell in cells for output in cell.outputs]
    assert {output.output_type for output in outputs} <= {
        "stream",
        "display_data",
        "execute_result",
    }
    assert {output.name for output in outputs if output.output_type == "stream"} == {"stdout"}
    assert sum("image/png" in output.get("data", {}) for output in outputs) >= 12
    assert TUTORIAL.stat().st_size < 2**20  # as for any other file


def test_what_is_kept_tells_nothing_of_the_machine(kept: NotebookNode) -> None:
    assert kept.metadata["language_info"] == {"name": "python"}
    assert [cell.id for cell in kept.cells if cell.metadata] == []
    outputs = [output for cell in code_cells(kept) for output in cell.outputs]
    texts = [
        output.get("text", "") + output.get("data", {}).get("text/plain", "") for output in outputs
    ]
    assert [text for text in texts if PATH_OF_A_MACHINE.search(text)] == []


@pytest.mark.parametrize("text", ["root is /tmp/abc", "in '/home/me/x'", "C:\\Users", "~/city"])
def test_paths_of_machines_are_known(text: str) -> None:
    assert PATH_OF_A_MACHINE.search(text)


def test_links_of_the_tutorial_lead_somewhere(kept: NotebookNode) -> None:
    text = "\n".join(cell.source for cell in kept.cells if cell.cell_type == "markdown")
    targets = re.findall(r"\]\(([^)\s]+)\)", text)
    assert len(targets) >= 4
    assert [target for target in targets if not (TUTORIAL.parent / target).exists()] == []
