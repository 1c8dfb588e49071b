"""How near a vocabulary comes to held-out drives, and how many of its paths no car could drive."""

import time
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path

import numpy as np
from benchmarks.machine import processor_name
from run_queue import Record, read_json

from lss_core.config import CAMERAS
from lss_core.data.samples import load_index, rows_of_split
from lss_core.geometry import FloatArray
from shoot.metrics.comfort import measure_comfort
from shoot.simulation.vehicle import MAX_BRAKE_MPS2
from shoot.templates import fit_templates
from shoot.trajectories import mine_futures
from shoot.world.config import VERSION
from vocabulary_table.vocabularies import Vocabulary

_SEED = 0


@dataclass(frozen=True)
class Drives:
    """Driven futures of a data set.

    Attributes:
        fitted: [M, T, 2] of the training scenes, in metres in `ego`.
        held_out: [V, T, 2] of the validation scenes.
        scenes: Number of training and of validation scenes.
        world: Card of the data set.
    """

    fitted: FloatArray
    held_out: FloatArray
    scenes: tuple[int, int]
    world: Record


def read_drives(root: Path) -> Drives:
    """Those that shoot-fit-templates takes: from every sweep with 5 s recorded after it."""
    index = load_index(str(root), VERSION, CAMERAS)
    rows = [rows_of_split(index, str(root), VERSION, split) for split in ("train", "val")]
    fitted, held_out = (mine_futures(index, own, "sweeps").xy_m for own in rows)
    num_train, num_val = (len(np.unique(index.sample_scene[own])) for own in rows)
    return Drives(fitted, held_out, (num_train, num_val), read_json(root / "world.json"))


def measure(vocabulary: Vocabulary, drives: Drives) -> Record:
    """Fit a vocabulary; what there is to say of it.

    Time is that of the processor, all threads together: others may be at work on the machine.
    """
    started_s = time.process_time()
    templates = fit_templates(drives.fitted, vocabulary.k, _SEED, method=vocabulary.method)
    fit_cpu_s = time.process_time() - started_s
    return {
        "name": vocabulary.name,
        "method": vocabulary.method,
        "k": vocabulary.k,
        "seed": _SEED,
        "settings": templates.card.get("settings", {}),
        "templates_sha256": templates.sha256,
        "fit_cpu_s": fit_cpu_s,
        "coverage": {
            "train": asdict(templates.coverage(drives.fitted)),
            "val": asdict(templates.coverage(drives.held_out)),
        },
        "unused_percent": 100.0 * float((templates.counts == 0).mean()),
        "feel": _feel(templates.points),
        "driven_feel": _feel(drives.held_out),
        "num_scenes": list(drives.scenes),
        "world": drives.world,
        "processor": processor_name(),
        "libraries": {name: version(name) for name in ("numpy", "scikit-learn", "scipy")},
    }


def _feel(paths: FloatArray | np.ndarray) -> dict[str, float]:
    """Shares in per cent of paths that no car could drive, and of those that nobody would like.

    Infeasible: an acceleration, ahead or aside, is beyond what the simulated car's tyres hold.
    Uncomfortable: out of the bounds of `shoot.metrics.comfort`.
    """
    measured = measure_comfort(paths)
    worst_mps2 = np.maximum(measured["lon_accel_mps2"], measured["lat_accel_mps2"])
    return {
        "infeasible_percent": 100.0 * float((worst_mps2 > MAX_BRAKE_MPS2).mean()),
        "uncomfortable_percent": 100.0 - float(measured["comfort"].mean()),
    }
