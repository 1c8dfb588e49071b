"""A trained segmentation on one split, from checkpoint to report."""

from dataclasses import replace

from lss_core.errors import DataError
from lss_core.legible import legible
from shoot.evaluation.report import condition_of
from shoot.evaluation.segmentation.counting import CellCounter
from shoot.evaluation.segmentation.results import SegmentationReport
from shoot.evaluation.segmentation.summary import summarise
from shoot.prediction.segmenter import TrainedSegmenter, predict_maps
from shoot.training.run_scenes import RunScenes, count_seen
from shoot.training.segmentation.data import SegmentSplit


def score_segmentation(
    run: TrainedSegmenter, samples: SegmentSplit, split: str, allow_seen_scenes: bool = False
) -> SegmentationReport:
    """Count cells while maps are predicted, and sum up.

    Args:
        run: Trained segmentation.
        samples: Of the split.
        split: Its name.
        allow_seen_scenes: Score also scenes that the run was trained on.

    Raises:
        DataError: If data is not as it should be, the run has seen it, or its training diverged.
    """
    num_seen = _count_seen(run, samples, allow_seen_scenes)
    classes, grid = run.config.classes, run.config.model.grid
    index = samples.index
    counter = CellCounter(samples.scene_rows, len(classes), grid)
    for batch, probabilities in predict_maps(run, samples):
        scenes = index.sample_scene[batch.sensors.sample_idx.cpu().numpy()]
        counter.add(probabilities.float().cpu().numpy(), batch.labels.cpu().numpy(), scenes)
    counts = counter.counts()
    report = summarise(
        counts,
        classes,
        grid,
        split,
        [str(name) for name in index.scene_name[counts.scene]],
        [condition_of(str(text)) for text in index.scene_description[counts.scene]],
        None if samples.logs is None else [str(log) for log in index.scene_log[counts.scene]],
        rule=run.config.rule,
    )
    return replace(report, num_bad_samples=len(samples.left_out), num_seen_scenes=num_seen)


def _count_seen(run: TrainedSegmenter, samples: SegmentSplit, allow: bool) -> int:
    """How many scenes the run has seen, if it is allowed."""
    kept = RunScenes.load(run.folder.scenes_file)
    if kept is None:
        if allow:
            return 0
        raise DataError(
            f"'{legible(str(run.folder.folder))}' has no {run.folder.scenes_file.name}, so nobody "
            "knows what the run was trained on; copy it from the run, or go on all the same with "
            "--allow-seen-scenes."
        )
    return count_seen(samples.scenes, kept.trained, allow=allow)
