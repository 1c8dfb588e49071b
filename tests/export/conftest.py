"""The tiny run and its ONNX file, made once."""

from pathlib import Path

import pytest
from exported_run import Exported, export_tiny
from world_fixture import TinyRun

from shoot.export.onnx_file import write_onnx


@pytest.fixture(scope="session")
def exported(tiny_run: TinyRun) -> Exported:
    return export_tiny(tiny_run)


@pytest.fixture(scope="session")
def onnx_planner(exported: Exported, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("exported") / "planner.onnx"
    write_onnx(exported.graph, path)
    return path
