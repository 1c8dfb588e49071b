"""Tiny worlds that several tests read."""

from pathlib import Path

import pytest
from small_city import config, start

from shoot.world import joining, writer
from shoot.world.config import VERSION
from shoot.world.writer import make_world


@pytest.fixture(scope="session")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three scenes in two towns; not to be changed."""
    folder = tmp_path_factory.mktemp("worlds") / "world"
    assert start(folder).wait() == 0
    return folder


@pytest.fixture(scope="session")
def mended(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A world of another seed with all sweeps, whose making failed once at the very end."""

    def broken(*_: object) -> None:
        raise OSError("disk full")

    folder = tmp_path_factory.mktemp("mended")
    small = config(folder, seed=4, train_scenes=0, duration_s=0.6, sweeps="all")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(joining, "write_mask", broken)
        with pytest.raises(OSError, match="disk full"):
            make_world(small)
    assert not (folder / VERSION).exists()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(writer, "capture_scene", broken)  # nothing is made twice
        make_world(small)
    return folder
