"""The ONNX file in onnxruntime: PyTorch's probabilities, by standard operators only."""

import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from exported_run import Exported

from lss_core.batch import Batch
from lss_core.errors import DataError
from shoot.export import onnx_file
from shoot.export.card import make_card, write_card
from shoot.export.numpy_inputs import make_splat_index
from shoot.export.onnx_file import OPSET, write_onnx
from shoot.export.samples import inputs_of

onnx = pytest.importorskip("onnx")
onnxruntime = pytest.importorskip("onnxruntime")


def probabilities(file: Path, card: dict, sensors: Batch) -> np.ndarray:
    session = onnxruntime.InferenceSession(file, providers=["CPUExecutionProvider"])
    return np.concatenate(
        [
            session.run(["probabilities"], inputs_of(card, sensors, b))[0]
            for b in range(len(sensors.sample_idx))
        ]
    )


def top10(prob: np.ndarray) -> list[set[int]]:
    return [set(row) for row in np.argsort(-prob, axis=-1)[:, :10].tolist()]


@pytest.mark.parametrize("missing", [(), (1,), (0, 4)])
def test_onnxruntime_says_what_pytorch_says(
    exported: Exported, onnx_planner: Path, missing: tuple[int, ...]
) -> None:
    sensors = exported.without(*missing)
    expected = exported.expected(sensors)
    assert expected.std() > 0.005
    assert np.abs(expected - exported.expected(exported.without(2))).max() > 1e-3
    prob = probabilities(onnx_planner, exported.card, sensors)
    np.testing.assert_allclose(prob, expected, rtol=0.0, atol=1e-4)
    assert top10(prob) == top10(expected)


def test_rigs_of_other_numbers_of_cameras_and_lists_of_fixed_length(
    exported: Exported, onnx_planner: Path
) -> None:
    """A camera that is not there and one that is masked are the same."""
    sensors, card = exported.sensors, exported.card
    expected = exported.expected(exported.without(0, 3, 5))
    session = onnxruntime.InferenceSession(onnx_planner, providers=["CPUExecutionProvider"])
    kept = [1, 2, 4]
    calibration = [
        part[0, kept].numpy() for part in (sensors.pixel_from_camera, sensors.ego_from_camera)
    ]
    index = make_splat_index(card, *calibration, num_points=3 * card["points_a_camera"])
    inputs = {"images": sensors.images[:1, kept].numpy(), "splat_index": index}
    (prob,) = session.run(["probabilities"], inputs)
    np.testing.assert_allclose(prob, expected[:1], rtol=0.0, atol=1e-4)


def test_standard_operators_only_and_no_sequences(onnx_planner: Path) -> None:
    model = onnx.load(onnx_planner)
    onnx.checker.check_model(model, full_check=True)
    assert [(opset.domain, opset.version) for opset in model.opset_import] == [("", OPSET)]
    assert OPSET >= 17
    assert not model.functions
    operators = {node.op_type for node in model.graph.node}
    assert {node.domain for node in model.graph.node} == {""}
    assert {"Gather", "Mul", "ScatterElements"} <= operators
    assert not {name for name in operators if "Sequence" in name} | operators & {
        "If",
        "Loop",
        "Scan",
    }


def test_inputs_and_outputs_have_their_names_and_sizes(
    exported: Exported, onnx_planner: Path
) -> None:
    graph = onnx.load(onnx_planner).graph
    shapes = {
        value.name: [d.dim_param or d.dim_value for d in value.type.tensor_type.shape.dim]
        for value in (*graph.input, *graph.output)
    }
    window = exported.card["cost_map"]
    assert shapes == {
        "images": [1, "num_cameras", 3, 32, 96],
        "splat_index": [3, "num_points"],
        "probabilities": [1, 24],
        "cost_map": [1, 1, window["num_x"], window["num_y"]],
    }


def test_the_file_tells_nothing_of_the_machine_it_was_made_on(onnx_planner: Path) -> None:
    content = onnx_planner.read_bytes()
    assert str(Path(onnx_file.__file__).parents[2]).encode() not in content
    assert b"site-packages" not in content


_ALONE = """
import json, sys

class Blocked:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in ("torch", "shoot", "lss_core", "scipy"):
            raise ImportError(name + " is not to be had here")

sys.meta_path.insert(0, Blocked())
import numpy as np
import onnxruntime
from numpy_inputs import make_splat_index

card = json.load(open("planner.json"))
session = onnxruntime.InferenceSession("planner.onnx", providers=["CPUExecutionProvider"])
given = np.load("given.npz")
found = []
for b in range(len(given["images"])):
    index = make_splat_index(card, *(given[name][b] for name in ("intrinsics", "poses", "mask")))
    inputs = {"images": given["images"][b][None], "splat_index": index}
    found.append(session.run(["probabilities"], inputs)[0][0])
np.save("found.npy", np.array(found))
assert "torch" not in sys.modules
"""


def test_numpy_and_onnxruntime_are_all_that_is_needed(
    exported: Exported, onnx_planner: Path, tmp_path: Path
) -> None:
    folder, sensors = tmp_path, exported.without(3)
    shutil.copy(onnx_planner, folder / "planner.onnx")
    write_card(make_card(exported.run, exported.graph), folder / "planner.json")
    helper = Path(onnx_file.__file__).with_name("numpy_inputs.py")
    (folder / "numpy_inputs.py").write_bytes(helper.read_bytes())
    np.savez(
        folder / "given.npz",
        images=sensors.images.numpy(),
        intrinsics=sensors.pixel_from_camera.numpy(),
        poses=sensors.ego_from_camera.numpy(),
        mask=sensors.camera_mask.numpy(),
    )
    done = subprocess.run(
        [sys.executable, "-c", _ALONE], cwd=folder, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    expected = exported.expected(sensors)
    found = np.load(folder / "found.npy")
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-4)
    assert top10(found) == top10(expected)


def test_the_helper_is_imported_without_torch() -> None:
    blocked = (
        "import sys; sys.modules['torch'] = None\n"
        "from shoot.export.numpy_inputs import make_splat_index"
    )
    done = subprocess.run(
        [sys.executable, "-c", blocked], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr


def test_missing_packages_are_named(
    exported: Exported, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "onnxscript", None)
    with pytest.raises(DataError, match=r"needs onnxscript.*pip install 'shoot-planner\[export\]'"):
        write_onnx(exported.graph, tmp_path / "planner.onnx")
    assert not list(tmp_path.iterdir())
