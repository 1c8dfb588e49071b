"""The example of docs/export.md, run as a user has it: the exported folder, NumPy, onnxruntime."""

import json
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from exported_run import Exported
from world_fixture import command

from shoot.export.companions import write_companions
from shoot.moment.example import SPEED_MPS, write_example
from shoot.prediction.shipped import shipped_run

pytest.importorskip("onnxruntime")

PAGE = Path(__file__).parents[2] / "docs" / "export.md"
ALONE = """
import sys
for name in ("torch", "shoot", "lss_core"):
    sys.modules[name] = None
import numpy as np
"""
BEFORE = """
given = np.load("rig.npz")
rig = list(zip(given["files"], given["intrinsics"], given["poses"]))
"""
AFTER = """
np.savez("found.npz", images=inputs["images"], probabilities=probabilities)
"""


def run_page(rig: str, folder: Path) -> Any:
    """What the page's code finds for that rig, in a process that has neither torch nor shoot."""
    (code,) = re.findall(r"^```python\n(.*?)^```", PAGE.read_text(), re.MULTILINE | re.DOTALL)
    done = subprocess.run(
        [sys.executable, "-c", ALONE + rig + code + AFTER],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert re.fullmatch(
        r"(0\.\d+: ends -?[\d.]+ m ahead, -?[\d.]+ m to the left\n){3}", done.stdout
    )
    return np.load(folder / "found.npz")


def test_the_pages_example_is_the_planner(
    exported: Exported, onnx_planner: Path, tmp_path: Path
) -> None:
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
    found = run_page(BEFORE, tmp_path)
    # Resized as a whole, not where it is kept: a level here and there.
    levels = found["images"][0].astype(int) - sensors.images[0].numpy().astype(int)
    assert np.abs(levels).max() <= 2
    expected = exported.expected(sensors)[:1]
    np.testing.assert_allclose(found["probabilities"], expected, rtol=0.0, atol=0.01)
    assert found["probabilities"].argmax() == expected.argmax()


@pytest.mark.slow
def test_the_shipped_planner_on_the_example_of_shoot_plan(tmp_path: Path) -> None:
    images = write_example(tmp_path)
    named = [f"{name}={path}" for name, path in images.items()]
    out = ("--out", tmp_path / "plan.json", "--picture", tmp_path / "plan.png")
    rig = ("--rig", tmp_path / "rig.yaml", "--speed-mps", SPEED_MPS)
    said = command("shoot-plan", *rig, "--images", *named, *out)
    assert said.status == 0, said.err
    said = command("shoot-export", shipped_run(), "--onnx", tmp_path / "planner.onnx")
    assert said.status == 0, said.err
    (line,) = re.findall(r"`(rig = .*)`", PAGE.read_text())
    found = run_page(f"import json\nplan = json.load(open('plan.json'))\n{line}\n", tmp_path)
    ranked = json.loads((tmp_path / "plan.json").read_text())["ranked"]
    expected = np.asarray([one["probability"] for one in ranked])
    probabilities = found["probabilities"][0, [one["template"] for one in ranked]]
    # Resized as a whole, as above.
    np.testing.assert_allclose(probabilities, expected, rtol=0.0, atol=0.01)
    assert found["probabilities"].argmax() == ranked[0]["template"]
