"""Data sets that tests of the index may damage, and caches of their own."""

from pathlib import Path

import pytest
from tiny_tables import TRAIN_A, VAL, write_tiny

from lss_core.config import CAMERAS


@pytest.fixture
def tiny_copy(tmp_path: Path) -> Path:
    """A small data set that a test may damage, with two cameras."""
    return write_tiny(tmp_path / "data", (TRAIN_A, VAL), cameras=CAMERAS[:2], image_hw=(36, 64))


@pytest.fixture
def own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = tmp_path / "own_cache"
    monkeypatch.setenv("SHOOT_CACHE", str(folder))
    return folder
