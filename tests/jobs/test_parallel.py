"""Jobs in other processes and on a dask cluster: the same results, and an end to everything."""

import math
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import fields, replace
from pathlib import Path

import dask
import numpy as np
import pytest
from distributed import LocalCluster
from world_fixture import TinyRun, command

from lss_core.config import CAMERAS
from lss_core.data.samples import load_index
from lss_core.errors import DataError
from shoot.jobs import parallel
from shoot.jobs.parallel import run_jobs
from shoot.templates import TemplateSet
from shoot.trajectories import mine_futures
from shoot.world.config import MakeWorldConfig
from shoot.world.writer import make_world

SLEEPERS = """
import os, sys, time
from pathlib import Path
from shoot.jobs.parallel import run_jobs

def sleep(path):
    Path(path).with_suffix(".part").write_text(str(os.getpid()))
    Path(path).with_suffix(".part").rename(path)
    time.sleep(300)

if __name__ == "__main__":
    for _ in run_jobs(sleep, sys.argv[1:], workers=2):
        pass
"""


@pytest.fixture(scope="module")
def cluster() -> Iterator[str]:
    """Address of a scheduler with two workers; one that dies is not forgiven."""
    settings = {"distributed.scheduler.allowed-failures": 0}
    with (
        dask.config.set(settings),
        LocalCluster(
            n_workers=2, threads_per_worker=1, dashboard_address=":0", silence_logs=50
        ) as local,
    ):
        yield local.scheduler_address


def test_worker_that_is_ended_from_outside() -> None:
    with pytest.raises(DataError, match="ended from outside"):
        list(run_jobs(signal.raise_signal, [signal.SIGKILL, signal.SIGKILL], workers=2))


@pytest.mark.parametrize("workers", [1, 2])
def test_results_of_all_jobs(workers: int) -> None:
    assert sorted(run_jobs(math.sqrt, [9, 4, 0, 1], workers)) == [0, 1, 2, 3]
    assert list(run_jobs(math.sqrt, [], workers)) == []


@pytest.mark.parametrize("workers", [1, 2])
def test_what_a_job_raises_ends_the_run(workers: int) -> None:
    with pytest.raises(ValueError, match="math domain"):
        list(run_jobs(math.sqrt, [4, -1, 9], workers))


def test_a_killed_run_leaves_no_workers(tmp_path: Path) -> None:
    script = tmp_path / "sleepers.py"
    script.write_text(SLEEPERS)
    notes = [tmp_path / "one", tmp_path / "two"]
    run = subprocess.Popen([sys.executable, script, *notes])
    deadline = time.monotonic() + 60
    while not all(note.exists() for note in notes) and time.monotonic() < deadline:
        time.sleep(0.02)
    workers = [int(note.read_text()) for note in notes]
    os.kill(run.pid, signal.SIGKILL)
    run.wait()
    while any(is_alive(worker) for worker in workers):
        assert time.monotonic() < deadline, "a worker has outlived its run"
        time.sleep(0.02)


def is_alive(pid: int) -> bool:
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except (FileNotFoundError, ProcessLookupError):
        return False
    return state != "Z"


@pytest.mark.full
def test_a_cluster_writes_the_same_world(
    cluster: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)  # the workers are elsewhere
    config = MakeWorldConfig(
        out=Path("here"), train_scenes=0, val_scenes=2, seed=3, image_scale=0.05, workers=1,
        duration_s=0.6, lidar_azimuths=16,
    )  # fmt: skip
    make_world(config)
    make_world(replace(config, out=Path("there"), dask=cluster))
    here, there = (read_all(tmp_path / name) for name in ("here", "there"))
    assert here == there
    assert len([name for name in here if name.endswith(".jpg")]) >= 12


def read_all(root: Path) -> dict[str, bytes]:
    return {
        str(path.relative_to(root)): path.read_bytes() for path in root.rglob("*") if path.is_file()
    }


def test_a_cluster_mines_the_same_futures(cluster: str, tiny_run: TinyRun, tmp_path: Path) -> None:
    index = load_index(tiny_run.root, "v1.0-trainval", CAMERAS)
    rows = np.arange(len(index.time_s))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("shoot.trajectories.mining._SCENES_A_JOB", 2)  # several jobs
        there = mine_futures(index, rows, "keyframes", cluster)
    here = mine_futures(index, rows, "keyframes")
    for field in fields(here):
        np.testing.assert_array_equal(getattr(there, field.name), getattr(here, field.name))
    out = tmp_path / "templates.npz"
    said = command(
        "shoot-fit-templates", "--data.root", tiny_run.root, "--out", out,
        "--k", len(TemplateSet.load(tiny_run.templates).points), "--dask", cluster,
    )  # fmt: skip
    assert said.status == 0, said.err
    assert TemplateSet.load(out).sha256 == TemplateSet.load(tiny_run.templates).sha256


@pytest.mark.full
def test_a_cluster_drives_the_same_routes(cluster: str, tmp_path: Path) -> None:
    said = [
        command(
            "shoot-simulate", "--driver", "still", "--routes", 2, "--out", tmp_path / name, *how
        )
        for name, how in (("here", ("--workers", 1)), ("there", ("--dask", cluster)))
    ]
    assert [one.status for one in said] == [0, 0]
    routes = {
        name: [path.read_bytes() for path in sorted((tmp_path / name / "routes").glob("*.json"))]
        for name in ("here", "there")
    }
    assert len(routes["here"]) == 2
    assert routes["here"] == routes["there"]


def test_what_fails_on_a_cluster_fails_here(cluster: str) -> None:
    with pytest.raises(ValueError, match="math domain"):
        list(run_jobs(math.sqrt, [4, -1, 9], dask=cluster))


def test_a_folder_that_workers_do_not_see(
    cluster: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    # A name that means another folder in each process.
    with pytest.raises(DataError, match="does not see '/proc/self/cwd'"):
        list(run_jobs(math.sqrt, [1], dask=cluster, shared=Path("/proc/self/cwd")))
    assert list(tmp_path.iterdir()) == []


def test_a_job_that_kills_its_worker_ends_the_run(cluster: str) -> None:
    with pytest.raises(DataError, match="call the command again"):
        list(run_jobs(os._exit, [1, 1], dask=cluster))


def test_a_scheduler_without_workers(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(parallel, "_PATIENCE_S", 0.5)
    with (
        LocalCluster(n_workers=0, dashboard_address=":0", silence_logs=50) as empty,
        pytest.raises(DataError, match="has no workers"),
    ):
        list(run_jobs(math.sqrt, [1], dask=empty.scheduler_address))


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:9", "nonsense", "ftp://127.0.0.1:21"])
def test_no_scheduler(address: str, tmp_path: Path) -> None:
    said = command("shoot-make-world", tmp_path / "world", "--dask", address)
    assert said.status == 2
    assert said.err.count("\n") == 1
    assert said.err.startswith(f"error: No dask scheduler answers at '{address}'")


def test_without_the_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    said = command("shoot-make-world", tmp_path / "world", "--dask", "tcp://127.0.0.1:9")
    assert said.status == 2
    assert "extra 'cluster'" in said.err
