"""What a finished run leaves behind: one small JSON, from which every table is made again."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from benchmarks.machine import processor_name

from lss_core.files import write_atomically
from planning_table.experiments import Experiment
from shoot.training.planning.run_folder import PlanningRun

Record = dict[str, Any]

# Of methods part by part; everything else is kept for all samples together only.
_PART_METRICS = ("top10", "nll", "min_ade_10", "l2_at_3s")
_PART_METHODS = ("model", "model_knowing_speed", "prior", "speed_prior", "blind")
_PARTS = ("by_manoeuvre", "by_speed", "by_condition")


def record_of(experiment: Experiment, folder: Path, jobs: int) -> Record:
    """What is worth keeping of a finished run."""
    report = _read(folder / "report.json")
    run = PlanningRun(folder)
    config = run.config()
    return {
        "name": experiment.name,
        "planner": experiment.planner,
        "preset": experiment.preset,
        "seed": experiment.seed,
        "flags": list(experiment.flags),
        "train_s": _read(run.time_file)["train_s"],
        "evaluate_s": _read(folder / "evaluation_time.json")["evaluate_s"],
        "runs_side_by_side": jobs,
        "processor": processor_name(),
        "environment": _read(folder / "environment.json"),
        "world": _read(Path(config.data.root) / "world.json"),
        "templates_sha256": run.templates().sha256,
        "steps": config.optim.steps,
        "batch_size": config.optim.batch_size,
        "precision": config.precision,
        "lidar_scans": config.data.lidar_scans,
        "image_hw": [config.data.image.height_px, config.data.image.width_px],
        "train_split": config.train_split,
        **{
            key: report[key]
            for key in (
                "split", "num_samples", "num_scenes", "num_boxes_left_out",
                "num_samples_with_boxes_left_out", "methods", "differences", "oracle", "driver",
                "by_scene",
            )
        },
        **{kind: {name: _part(part) for name, part in report[kind].items()} for kind in _PARTS},
    }  # fmt: skip


def save_record(record: Record, path: Path) -> None:
    """Write a record, numbers to four digits: more is noise, and the files are under git."""
    with write_atomically(path) as stream:
        stream.write((json.dumps(_rounded(record), indent=1) + "\n").encode())


def load_records(folder: Path) -> list[Record]:
    """All records of a folder, by name."""
    return [_read(path) for path in sorted(folder.glob("*.json"))]


def bases_of(record: Record, records: Sequence[Record]) -> list[Record]:
    """The runs of which a record's run changed one thing: those of every seed, none of itself."""
    if not record["flags"]:
        return []
    return [r for r in records if not r["flags"] and r["preset"] == record["preset"]]


def _part(part: Record) -> Record:
    return {
        "num_samples": part["num_samples"],
        "num_scenes": part["num_scenes"],
        "methods": {
            method: {metric: part["methods"][method][metric] for metric in _PART_METRICS}
            for method in _PART_METHODS
            if method in part["methods"]
        },
    }


def _rounded(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _rounded(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_rounded(item) for item in value]
    return float(f"{value:.4g}") if isinstance(value, float) else value


def _read(path: Path) -> Record:
    loaded: Record = json.loads(path.read_text(encoding="utf-8"))
    return loaded
