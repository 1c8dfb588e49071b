"""What the tests of the commands share: data, templates and a trained run, made once a session.

The data set is hand-made like `tiny_tables`, but its cars change their speed: no two futures are
alike, and templates can be fitted to them.
"""

import contextlib
import io
import logging
import math
import multiprocessing
import os
import shutil
import sys
import warnings
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any

import pytest
from filelock import FileLock
from tiny_tables import TinyScene, write_tiny

from shoot.baselines import past_motion
from shoot.cli import (
    check,
    convert,
    evaluate,
    export,
    fit_templates,
    make_world,
    plan,
    render,
    simulate,
    train,
    view,
)

NUM_TEMPLATES = 24
# 7 s of keyframes every 0.5 s, those at 0 s ... 2 s with five seconds of future.
SAMPLES_A_SCENE = 5
NUM_TRAIN_SCENES, NUM_VAL_SCENES = 4, 3

COMMANDS: dict[str, Callable[[], None]] = {
    "shoot-make-world": make_world.main,
    "shoot-check": check.main,
    "shoot-fit-templates": fit_templates.main,
    "shoot-train": train.main,
    "shoot-evaluate": evaluate.main,
    "shoot-render": render.main,
    "shoot-plan": plan.main,
    "shoot-simulate": simulate.main,
    "shoot-view": view.main,
    "shoot-convert": convert.main,
    "shoot-export": export.main,
}

# An epoch of the baseline of past motion, which most tests evaluate and few ask about: its own
# tests train it as users do.
FEW_STEPS = 4


@dataclass(frozen=True)
class TinyRide(TinyScene):
    """A car on a circular arc that gains or loses speed."""

    seconds: float = 7.0
    acceleration_mps2: float = 0.0

    def pose(self, time_s: float) -> tuple[float, float, float]:
        curvature = self.yaw_rate_radps / self.speed_mps
        way_m = self.speed_mps * time_s + 0.5 * self.acceleration_mps2 * time_s**2
        yaw = self.yaw_rad + curvature * way_m
        return (
            self.x_m + (math.sin(yaw) - math.sin(self.yaw_rad)) / curvature,
            self.y_m - (math.cos(yaw) - math.cos(self.yaw_rad)) / curvature,
            yaw,
        )


TRAIN_RIDES = (
    TinyRide("scene-0001", speed_mps=6.0, yaw_rate_radps=0.1, acceleration_mps2=0.6),
    TinyRide("scene-0002", speed_mps=3.0, yaw_rate_radps=-0.2, acceleration_mps2=0.9),
    TinyRide("scene-0004", speed_mps=9.0, yaw_rate_radps=0.01, acceleration_mps2=-1.1),
    TinyRide("scene-0005", speed_mps=1.0, yaw_rate_radps=0.02, acceleration_mps2=1.3),
)
VAL_RIDES = (
    TinyRide("scene-0003", speed_mps=5.0, yaw_rate_radps=0.12, acceleration_mps2=0.5),
    TinyRide(
        "scene-0012",
        speed_mps=8.0,
        yaw_rate_radps=-0.02,
        acceleration_mps2=-0.8,
        description="Night, rain; and a description that is long, as some of the real ones are",
    ),
    TinyRide("scene-0013", speed_mps=2.0, yaw_rate_radps=-0.05, acceleration_mps2=1.0),
)

# The smallest planner that still is one: every part is there.
SMALL_FLAGS = (
    "--data.image.height-px", "32",
    "--data.image.width-px", "96",
    "--model.backbone", "plain-4-6-8",
    "--model.context-channels", "4",
    "--model.neck-channels", "8",
    "--model.stem-channels", "8",
    "--model.decoder-channels", "8",
    "--model.depth.step-m", "7",
    "--model.grid.cell-m", "4",
    "--optim.batch-size", "2",
    "--optim.warmup-steps", "2",
    "--val-samples", "0",
    "--num-workers", "0",
    "--precision", "32-true",
)  # fmt: skip


@dataclass(frozen=True)
class Said:
    """What a command left behind."""

    status: int
    out: str
    err: str


@dataclass(frozen=True)
class TinyRun:
    """A data set, templates fitted to it and a planner trained on it; not to be changed."""

    root: Path
    templates: Path
    folder: Path


@dataclass(frozen=True)
class TinySegmenter:
    """A written city of a few moments and a segmentation trained on it; not to be changed."""

    root: Path
    folder: Path


def command(name: str, *arguments: object) -> Said:
    """Run a console command in this process."""
    out, err = io.StringIO(), io.StringIO()
    status = 0
    root_logger = logging.getLogger()
    before = root_logger.handlers[:], root_logger.level
    with pytest.MonkeyPatch.context() as patch, warnings.catch_warnings():
        patch.setattr(sys, "argv", [name, *map(str, arguments)])
        patch.setenv("COLUMNS", "200")
        patch.setattr(past_motion, "STEPS_AN_EPOCH", FEW_STEPS)
        root_logger.handlers.clear()  # so that the command sets up its own
        try:
            with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
                COMMANDS[name]()
        except SystemExit as ended:
            status = ended.code if isinstance(ended.code, int) else 1
        finally:
            root_logger.handlers[:], root_logger.level = before
    return Said(status, out.getvalue(), err.getvalue())


def evaluate(run: TinyRun, *more: object) -> Said:
    return command("shoot-evaluate", run.folder, "--out", run.folder / "report.json", *more)


def complaint(said: Said) -> str:
    """The sentence, if that is all there is."""
    assert said.status == 2, said.err
    assert "Traceback" not in said.out + said.err
    sentences = [line for line in said.err.splitlines() if line.strip()]
    assert len(sentences) == 1, said.err
    assert sentences[0].startswith("error: ")
    assert len(sentences[0]) < 600
    return sentences[0]


_SERVER = multiprocessing.get_context("forkserver")
# One process imports everything once; each side process is a fork of it.
_SERVER.set_forkserver_preload(
    [
        f"shoot.cli.{name}"
        for name in ("train", "evaluate", "fit_templates", "make_world", "simulate")
    ]
)


def start_beside(
    function: Callable[..., object],
    *arguments: Any,
    log: Path,
    environment: Mapping[str, str] | None = None,
) -> BaseProcess:
    """Call a function of a test module in another process, which may be killed.

    Args:
        function: What to call.
        arguments: With what.
        log: Where its output goes.
        environment: What it finds in its environment beside what is in ours.
    """
    given = {**os.environ, "OMP_NUM_THREADS": "1", **(environment or {})}
    process = _SERVER.Process(target=_beside, args=(function, arguments, log, given))
    process.start()
    return process


def result_beside(function: Callable[..., Any], *arguments: Any) -> Any:
    """What a function of a test module returns in another process.

    Types are not checked there and lines not counted, which makes what simulates long several times
    faster.
    """
    with ProcessPoolExecutor(1, mp_context=_SERVER) as others:
        return others.submit(function, *arguments).result()


def start_command(name: str, *arguments: object, log: Path) -> BaseProcess:
    """Start a console command in another process."""
    return start_beside(call_command, name, [str(argument) for argument in arguments], log=log)


def _beside(
    function: Callable[..., object], arguments: Sequence[Any], log: Path, given: Mapping[str, str]
) -> None:
    os.environ.clear()
    os.environ.update(given)
    with log.open("ab") as stream:
        os.dup2(stream.fileno(), 1)
        os.dup2(stream.fileno(), 2)
    # As in a command from a shell; else its workers would be forks of another server.
    multiprocessing.set_start_method("fork", force=True)
    function(*arguments)


def call_command(name: str, arguments: Sequence[str]) -> None:
    """Call a console command in a process that has nothing else to do."""
    sys.argv = [name, *arguments]
    past_motion.STEPS_AN_EPOCH = FEW_STEPS
    COMMANDS[name]()


def train_flags(root: Path, templates: Path, out: Path, steps: int, every: int) -> list[str]:
    """Arguments of shoot-train for a tiny run."""
    flags = ["demo", "--data.root", root, "--templates", templates, "--out", out]
    flags += ["--optim.steps", steps, "--val-every", every, *SMALL_FLAGS]
    return [str(flag) for flag in flags]


def write_rides(root: Path, rides: Sequence[TinyScene] = (*TRAIN_RIDES, *VAL_RIDES)) -> Path:
    """Write the data set; returns `root`."""
    return write_tiny(root, rides, image_hw=(45, 80))


def make_tiny_run(folder: Path) -> TinyRun:
    """Make everything, through the commands."""
    run = TinyRun(write_rides(folder / "data"), folder / "templates.npz", folder / "run")
    for said in (
        command(
            "shoot-fit-templates", "--data.root", run.root, "--out", run.templates,
            "--k", NUM_TEMPLATES,
        ),
        command("shoot-train", *train_flags(run.root, run.templates, run.folder, 4, 2)),
    ):  # fmt: skip
        assert said.status == 0, said.err
    return run


def copy_run(run: TinyRun, folder: Path) -> TinyRun:
    """A copy of data, templates and run that a test may spoil; the run reads the copied data."""
    copy = TinyRun(folder / "data", folder / "templates.npz", folder / "run")
    shutil.copytree(run.root, copy.root)
    shutil.copytree(run.folder, copy.folder)
    shutil.copy(run.templates, copy.templates)
    config = copy.folder / "config.yaml"
    config.write_text(config.read_text().replace(str(run.root), str(copy.root)))
    return copy


@pytest.fixture(scope="session")
def tiny_run(tmp_path_factory: pytest.TempPathFactory, worker_id: str, _own_cache: None) -> TinyRun:
    """A trained tiny run, shared by all workers of a session."""
    shared = _shared(tmp_path_factory, worker_id, "tiny-run", make_tiny_run)
    return TinyRun(shared / "data", shared / "templates.npz", shared / "run")


def segment_flags(root: Path, out: Path, steps: int, every: int) -> list[str]:
    """Arguments of shoot-train for a tiny segmentation."""
    flags = ["segment", "--data.root", root, "--out", out]
    flags += ["--optim.steps", steps, "--val-every", every, *SMALL_FLAGS]
    return [str(flag) for flag in flags]


def make_tiny_segmenter(folder: Path) -> TinySegmenter:
    """Make everything, through the commands."""
    made = TinySegmenter(folder / "city", folder / "run")
    city = (
        "--train-scenes", "2", "--val-scenes", "1", "--duration-s", "1.5", "--seed", "3",
        "--image-scale", "0.08", "--lidar-azimuths", "48", "--workers", "1",
    )  # fmt: skip
    writing = start_command("shoot-make-world", made.root, *city, log=folder / "city.log")
    writing.join()
    assert writing.exitcode == 0, (folder / "city.log").read_text()
    said = command("shoot-train", *segment_flags(made.root, made.folder, 4, 2))
    assert said.status == 0, said.err
    return made


@pytest.fixture(scope="session")
def tiny_segmenter(
    tmp_path_factory: pytest.TempPathFactory, worker_id: str, _own_cache: None
) -> TinySegmenter:
    """A trained tiny segmentation, shared by all workers of a session."""
    shared = _shared(tmp_path_factory, worker_id, "tiny-segmenter", make_tiny_segmenter)
    return TinySegmenter(shared / "city", shared / "run")


def _shared(
    factory: pytest.TempPathFactory, worker_id: str, name: str, make: Callable[[Path], object]
) -> Path:
    """A folder that the first worker of a session makes and all others wait for."""
    base = factory.getbasetemp()
    shared = (base if worker_id == "master" else base.parent) / name
    done = shared / "done"
    with FileLock(f"{shared}.lock"):
        if not done.exists():
            shared.mkdir(exist_ok=True)
            make(shared)
            done.touch()
    return shared
