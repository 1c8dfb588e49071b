"""Fixtures that many tests share."""

import os
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import settings
from tiny_tables import write_tiny
from world_fixture import TinyRun, copy_run, tiny_run, tiny_segmenter  # noqa: F401

settings.register_profile("shoot", deadline=None, derandomize=True, database=None)
settings.load_profile("shoot")

_REAL_BESIDE = Path(__file__).resolve().parents[2] / "shared" / "data" / "nuscenes_real"
_LYFT_BESIDE = Path(__file__).resolve().parents[2] / "shared" / "data" / "lyft_tiny" / "v1.01-train"


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave the full forms out unless asked for; begin with what takes long: all end together."""
    if "full" not in config.getoption("-m"):
        left_out = [item for item in items if item.get_closest_marker("full")]
        if left_out:
            config.hook.pytest_deselected(items=left_out)
            items[:] = [item for item in items if not item.get_closest_marker("full")]
    items.sort(key=lambda item: item.get_closest_marker("slow") is None)


@pytest.fixture(scope="session", autouse=True)
def _own_cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Indices of test data sets stay out of the user's cache."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("SHOOT_CACHE", str(tmp_path_factory.mktemp("cache")))
        yield


@pytest.fixture(scope="session")
def tiny_root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two training scenes and a validation scene, made by hand; not to be changed."""
    return write_tiny(tmp_path_factory.mktemp("tiny"))


@pytest.fixture
def spoilt(tiny_run: TinyRun, tmp_path: Path) -> TinyRun:  # noqa: F811
    """A copy of data and run that a test may damage; the run reads the copy."""
    return copy_run(tiny_run, tmp_path)


@pytest.fixture(scope="session")
def real_root() -> Path:
    """A real nuScenes scene, where there is one."""
    root = Path(os.environ.get("SHOOT_REAL_DATA", _REAL_BESIDE))
    if not (root / "v1.0-mini" / "sample_data.json").is_file():
        pytest.skip("No real nuScenes scene: SHOOT_REAL_DATA names no folder with v1.0-mini.")
    return root


@pytest.fixture(scope="session")
def lyft_root() -> Path:
    """Tables of Lyft Level 5, where there are some; no files of sensors."""
    root = Path(os.environ.get("SHOOT_LYFT_DATA", _LYFT_BESIDE))
    if not (root / "v1.01-train" / "sample_data.json").is_file():
        pytest.skip("No tables of Lyft: SHOOT_LYFT_DATA names no folder with v1.01-train.")
    return root
