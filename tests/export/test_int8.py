"""The file in int8: other convolutions, the same geometry, a loss that is measured."""

from pathlib import Path

import numpy as np
import pytest
from exported_run import Exported

from shoot.export.int8 import compare_files, quantise, run_file
from shoot.export.samples import inputs_of, read_inputs

onnx = pytest.importorskip("onnx")


def test_only_convolutions_change_and_the_loss_is_theirs(
    exported: Exported, onnx_planner: Path, tmp_path: Path
) -> None:
    whole, small = onnx_planner, tmp_path / "planner-int8.onnx"
    samples = [inputs_of(exported.card, exported.sensors, b) for b in range(3)]
    quantise(whole, small, samples)

    model = onnx.load(small)
    onnx.checker.check_model(model, full_check=True)
    assert {node.domain for node in model.graph.node} == {""}
    made_by = {output: node.op_type for node in model.graph.node for output in node.output}
    convolutions = [node for node in model.graph.node if node.op_type == "Conv"]
    in_int8 = [made_by.get(node.input[1]) == "DequantizeLinear" for node in convolutions]
    assert in_int8 == [True] * (len(convolutions) - 1) + [False]
    for name in ("ScatterElements", "Gather", "Softmax"):
        reads = [node for node in model.graph.node if node.op_type == name]
        assert reads
        assert all(made_by.get(i) != "DequantizeLinear" for node in reads for i in node.input)

    before, after = run_file(whole, samples), run_file(small, samples)
    found = compare_files(whole, small, samples)
    assert found.num_samples == 3
    assert found.largest_change == pytest.approx(np.abs(before - after).max())
    assert 0.0 < found.largest_change < 0.1
    assert 0.5 < found.top10 <= 1.0
    assert f"{100 * found.top10:.1f} %" in found.sentence
    same = compare_files(whole, whole, samples)
    assert (same.top10, same.largest_change) == (1.0, 0.0)


def test_samples_are_spread_over_a_split_and_no_more_than_there_are(exported: Exported) -> None:
    run = exported.run
    split = run.task.load_split(run.config.data, "val")
    every = list(read_inputs(run, exported.card, split, 1000))
    assert len(every) == len(split)
    three = list(read_inputs(run, exported.card, split, 3))
    for got, position in zip(three, (0, len(split) // 2, len(split) - 1), strict=True):
        np.testing.assert_array_equal(got["images"], every[position]["images"])
        np.testing.assert_array_equal(got["splat_index"], every[position]["splat_index"])
