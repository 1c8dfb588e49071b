"""What a finished segmentation leaves behind: its report, and what it was."""

from pathlib import Path

from run_queue import Experiment, Kind, Record, facts_of, read_json

from shoot.training.run_folder import RunFolder
from shoot.training.segmentation.config import SegmentConfig


def record_of(experiment: Experiment, folder: Path, jobs: int) -> Record:
    """What is worth keeping of a finished run; `by_scene` makes paired differences of two."""
    config = RunFolder(folder).read_config(SegmentConfig)
    return {
        "name": experiment.name,
        "method": experiment.planner,
        **facts_of(experiment, folder, config.data.root, jobs),
        "steps": config.optim.steps,
        "batch_size": config.optim.batch_size,
        "precision": config.precision,
        "image_hw": [config.data.image.height_px, config.data.image.width_px],
        "grid": list(config.model.grid.shape),
        **read_json(folder / "report.json"),
    }


def _told(record: Record) -> str:
    ious = (f"{name} {found['iou']['value']:.1f}" for name, found in record["classes"].items())
    return f"IoU in per cent: {', '.join(ious)}"


SEGMENTATIONS = Kind(
    train_flags=lambda place: (),
    evaluate_flags=lambda folder: (),
    record_of=record_of,
    told=_told,
)
