"""The four commands whose work must survive anything, as small as they can be."""

import hashlib
import json
from dataclasses import asdict, replace
from pathlib import Path

from filelock import FileLock
from killing import Job, Undisturbed, make_undisturbed
from world_fixture import TRAIN_RIDES, VAL_RIDES, TinyRun, train_flags, write_rides

COMMANDS = ("shoot-make-world", "shoot-fit-templates", "shoot-train", "shoot-evaluate")
STEPS, EVERY = 7, 2  # the last round is shorter

_WORLD = (
    "--train-scenes", "1",
    "--val-scenes", "1",
    "--image-scale", "0.05",
    "--duration-s", "0.6",
    "--lidar-azimuths", "16",
)  # fmt: skip


def make_job(name: str, data: TinyRun, folder: Path, workers: int = 0, fresh: bool = False) -> Job:
    """A command with its working directory.

    Args:
        name: Of the command.
        data: What it reads.
        folder: Its working directory; made when it starts.
        workers: Processes beside it that make worlds or load data, where it can have any.
        fresh: Start it in an interpreter that has imported nothing yet.
    """
    out = Path("out")  # the same in every working directory, and so in what it writes
    older: tuple[str, ...] = ()
    if name == "shoot-make-world":
        arguments: list[object] = [out, *_WORLD, "--workers", workers + 1]
    elif name == "shoot-train":
        arguments = [*train_flags(data.root, data.templates, out, STEPS, EVERY)]
        arguments += ["--resume", "--num-workers", workers]
    elif name == "shoot-fit-templates":
        arguments = ["--data.root", data.root, "--out", out / "t.npz", "--k", 9]
        older = ("t.npz", "t.json", "t.png")
    else:
        # One scene to score: pictures of its samples take most of the time.
        root = data.folder.parent / "one-scene"
        if not root.exists():
            write_rides(root, (*TRAIN_RIDES, VAL_RIDES[0]))
        arguments = [data.folder, "--data.root", root]
        arguments += ["--out", out / "report.json", "--html", out / "page.html"]
        older = ("report.json", "page.html")
    return Job(name, tuple(map(str, arguments)), folder, older, fresh)


def undisturbed(job: Job, data: TinyRun) -> Undisturbed:
    """What comes of a job that is left alone; found out once a session for all workers."""
    key = repr((job.name, job.arguments, job.in_fresh_python))
    folder = data.folder.parent / f"undisturbed-{hashlib.sha256(key.encode()).hexdigest()[:16]}"
    done = folder.with_suffix(".json")
    with FileLock(folder.with_suffix(".lock")):
        if not done.exists():
            made = make_undisturbed(replace(job, folder=folder / "work"), folder / "result")
            done.write_text(json.dumps(asdict(made) | {"folder": None}))
    return Undisturbed(**json.loads(done.read_text()) | {"folder": folder / "result"})
