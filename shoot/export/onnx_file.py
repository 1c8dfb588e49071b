"""The planner as an ONNX file: standard operators, no sequences, one sample at a time."""

from pathlib import Path
from types import ModuleType
from typing import Any

import torch

from lss_core.errors import DataError
from lss_core.files import write_atomically
from shoot.export.graph import PlannerGraph
from shoot.export.tracing import dynamic_shapes, example_inputs

OPSET = 18
_OUTPUTS = ("probabilities", "cost_map")


def import_onnx() -> ModuleType:
    """onnx, with all that exporting needs beside it.

    Raises:
        DataError: If something is not installed.
    """
    try:
        import onnx
        import onnxruntime  # noqa: F401
        import onnxscript  # noqa: F401
    except ImportError as error:
        raise DataError(
            f"Exporting as ONNX needs {error.name}, which is not installed: pip install "
            "'shoot-planner[export]'."
        ) from error
    if torch.torch_version.TorchVersion(torch.__version__) < "2.14":
        raise DataError(
            f"Exporting as ONNX needs torch 2.14 or later, not {torch.__version__}: pip install "
            "'shoot-planner[export]'."
        )
    module: ModuleType = onnx
    return module


def write_onnx(graph: PlannerGraph, path: Path) -> None:
    """Write the graph as ONNX, checked, whole or not at all.

    Raises:
        DataError: If packages are missing.
        OSError: If it cannot be written.
    """
    onnx = import_onnx()
    program = torch.onnx.export(
        graph,
        kwargs=example_inputs(graph),
        dynamo=True,
        opset_version=OPSET,
        input_names=list(example_inputs(graph)),
        output_names=_OUTPUTS,
        dynamic_shapes=dynamic_shapes(),
        verbose=False,
    )
    assert program is not None
    proto = program.model_proto
    _forget_sources(proto)
    onnx.checker.check_model(proto, full_check=True)
    with write_atomically(path) as stream:
        stream.write(proto.SerializeToString(deterministic=True))


def _forget_sources(proto: Any) -> None:
    """Take out what the exporter notes of the code that it came from, paths of this machine too."""
    graph = proto.graph
    for noted in (proto, graph, *graph.node, *graph.value_info, *graph.input, *graph.output):
        noted.ClearField("metadata_props")
        noted.ClearField("doc_string")
    for tensor in graph.initializer:
        tensor.ClearField("metadata_props")
        tensor.ClearField("doc_string")
