"""The report on the hand-made data set, and copies of it that a test may damage."""

import json
from pathlib import Path
from typing import Any

import pytest
from checked_data import report_of
from tiny_tables import copy_tiny

from lss_core.config import CAMERAS


@pytest.fixture(scope="module")
def checked(tiny_root: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of the report on the hand-made data set."""
    out = tmp_path_factory.mktemp("checked")
    report_of(tiny_root, out, cameras=CAMERAS)
    return out


@pytest.fixture(scope="module")
def report(checked: Path) -> dict[str, Any]:
    loaded: dict[str, Any] = json.loads((checked / "report.json").read_text())
    return loaded


@pytest.fixture
def spoilt(tiny_root: Path, tmp_path: Path) -> Path:
    """A copy that a test may damage."""
    return copy_tiny(tiny_root, tmp_path / "data")
