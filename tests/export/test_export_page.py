"""The example of docs/export.md, run as a user has it: the exported folder, NumPy, onnxruntime."""

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from exported_run import Exported

from shoot.export.companions import write_companions

PAGE = Path(__file__).parents[2] / "docs" / "export.md"
BEFORE = """
import sys
for name in ("torch", "shoot", "lss_core"):
    sys.modules[name] = None
import numpy
given = numpy.load("rig.npz")
rig = list(zip(given["files"], given["intrinsics"], given["poses"]))
"""
AFTER = """
numpy.savez("found.npz", images=inputs["images"], probabilities=probabilities)
"""


def test_the_pages_example_is_the_planner(
    exported: Exported, onnx_planner: Path, tmp_path: Path
) -> None:
    pytest.importorskip("onnxruntime")
    planner = tmp_path / "planner.onnx"
    planner.write_bytes(onnx_planner.read_bytes())
    write_companions(exported.run, exported.card, planner)
    data, sensors = exported.run.config.data, exported.sensors
    index = exported.run.task.load_split(data, "val").index
    row = int(sensors.sample_idx[0])
    np.savez(
        tmp_path / "rig.npz",
        files=[str(Path(data.root) / path) for path in index.image_path[row]],
        intrinsics=index.rawpixel_from_camera[row],
        poses=sensors.ego_from_camera[0].double().numpy(),
    )
    (code,) = re.findall(r"^```python\n(.*?)^```", PAGE.read_text(), re.MULTILINE | re.DOTALL)
    done = subprocess.run(
        [sys.executable, "-c", BEFORE + code + AFTER],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert re.fullmatch(
        r"(0\.\d+: ends -?[\d.]+ m ahead, -?[\d.]+ m to the left\n){3}", done.stdout
    )
    found = np.load(tmp_path / "found.npz")
    # Resized as a whole, not where it is kept: a level here and there.
    levels = found["images"][0].astype(int) - sensors.images[0].numpy().astype(int)
    assert np.abs(levels).max() <= 2
    expected = exported.expected(sensors)[:1]
    np.testing.assert_allclose(found["probabilities"], expected, rtol=0.0, atol=0.01)
    assert found["probabilities"].argmax() == expected.argmax()
