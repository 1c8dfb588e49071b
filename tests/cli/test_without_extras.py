"""With the core's libraries alone the shipped planner plans; other commands say what they need."""

import json
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

SETTINGS = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text())["project"]
LIBRARIES = {
    "embreex": "embreex",
    "gymnasium": "gymnasium",
    "joblib": "joblib",
    "nuscenes-devkit": "nuscenes",
    "opencv-python-headless": "cv2",
    "pytorch-lightning": "pytorch_lightning",
    "scikit-learn": "sklearn",
    "shapely": "shapely",
    "tensorboard": "tensorboard",
    "torchmetrics": "torchmetrics",
}


def call(folder: Path, name: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    """The command in a process where no extra is installed."""
    door = SETTINGS["scripts"][name].split(":")[1]
    program = (
        "import sys\n"
        # Of a module that is None, the import fails.
        f"sys.modules.update(dict.fromkeys({sorted(LIBRARIES.values())}))\n"
        f"sys.argv[0] = {name!r}\n"
        f"from shoot.cli.doors import {door}\n"
        f"{door}()\n"
    )
    return subprocess.run(
        [sys.executable, "-c", program, *arguments],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )


def test_the_shipped_planner_plans(tmp_path: Path) -> None:
    said = call(tmp_path, "shoot-plan", "--example", "try")
    assert said.returncode == 0, said.stderr
    said = call(tmp_path, *shlex.split(said.stdout.splitlines()[-1]))
    assert said.returncode == 0, said.stderr
    assert "The 10 most probable of 1000 templates" in said.stdout
    assert len(json.loads((tmp_path / "try" / "plan.json").read_text())["ranked"]) == 20
    assert (tmp_path / "try" / "plan.png").exists()


@pytest.mark.parametrize(
    ("name", "arguments", "extra"),
    [
        ("shoot-check", ("--data.root", "."), "train"),
        ("shoot-train", ("demo",), "train"),
        ("shoot-make-world", ("city",), "demo"),
    ],
)
def test_what_is_missing_is_named(
    name: str, arguments: tuple[str, ...], extra: str, tmp_path: Path
) -> None:
    said = call(tmp_path, name, *arguments)
    assert said.returncode == 2
    assert said.stderr.count("\n") == 1
    assert f"which is not installed: pip install 'shoot-planner[{extra}]'." in said.stderr


def test_every_library_of_an_extra_is_withheld() -> None:
    brought = {
        name.partition(">")[0]
        for extra in ("train", "demo")
        for name in SETTINGS["optional-dependencies"][extra]
    }
    assert brought == {*LIBRARIES, "shoot-planner[train]"}
