"""A tiny world on disk: three scenes of 1.5 s, small images."""

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

from shoot.world.config import MakeWorldConfig

DURATION_S = 1.5


def config(out: Path, **changes: object) -> MakeWorldConfig:
    plain = MakeWorldConfig(
        out=out, train_scenes=2, val_scenes=1, seed=3, image_scale=0.08, workers=1,
        scenes_per_town=2, duration_s=DURATION_S, lidar_azimuths=48,
    )  # fmt: skip
    return replace(plain, **changes)


def start(out: Path, **changes: object) -> "subprocess.Popen[bytes]":
    """Run the command in a process of its own (without the slow checks of types in tests)."""
    settings = {**config(out, **changes).__dict__}
    del settings["out"]
    flags = [
        word
        for name, value in settings.items()
        for word in (f"--{name.replace('_', '-')}", str(value))
    ]
    code = "from shoot.cli.make_world import main; main()"
    return subprocess.Popen(
        [sys.executable, "-c", code, str(out), *flags],
        stdout=subprocess.DEVNULL,
        env={**os.environ, "OMP_NUM_THREADS": "1"},
    )
