"""What a finished run leaves behind: one small JSON, from which every table is made again."""

from collections.abc import Sequence
from pathlib import Path

from run_queue import Experiment, Record, facts_of, read_json

from shoot.training.planning.run_folder import PlanningRun

# Of methods part by part; everything else is kept for all samples together only.
_PART_METRICS = ("top10", "nll", "min_ade_10", "l2_at_3s")
_PART_METHODS = ("model", "model_knowing_speed", "prior", "speed_prior", "blind")
_PARTS = ("by_manoeuvre", "by_speed", "by_condition")


def record_of(experiment: Experiment, folder: Path, jobs: int) -> Record:
    """What is worth keeping of a finished run."""
    report = read_json(folder / "report.json")
    run = PlanningRun(folder)
    config = run.config()
    return {
        "name": experiment.name,
        "planner": experiment.planner,
        **facts_of(experiment, folder, config.data.root, jobs),
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
