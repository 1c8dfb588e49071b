"""The planner as a program of `torch.export`, for runtimes that are built on torch."""

import io
from pathlib import Path

import torch

from lss_core.files import write_atomically
from shoot.export.graph import PlannerGraph
from shoot.export.tracing import dynamic_shapes, example_inputs


def write_program(graph: PlannerGraph, path: Path) -> None:
    """Write the graph so that `torch.export.load` reads it, whole or not at all.

    Its module takes its inputs by name.

    Raises:
        OSError: If it cannot be written.
    """
    with torch.no_grad():
        program = torch.export.export(
            graph, (), example_inputs(graph), dynamic_shapes=dynamic_shapes()
        )
    for node in program.graph.nodes:
        node.meta.pop("stack_trace", None)  # paths of this machine
    content = io.BytesIO()
    torch.export.save(program, content)
    with write_atomically(path) as stream:
        stream.write(content.getvalue())
