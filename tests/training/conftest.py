"""A training that nobody disturbs, which others must equal."""

from pathlib import Path

import pytest
from resumption import EVERY, STEPS
from world_fixture import TinyRun, command, train_flags


@pytest.fixture(scope="module")
def undisturbed(tiny_run: TinyRun, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("undisturbed") / "run"
    flags = train_flags(tiny_run.root, tiny_run.templates, folder, STEPS, EVERY)
    said = command("shoot-train", *flags)
    assert said.status == 0, said.err
    return folder
