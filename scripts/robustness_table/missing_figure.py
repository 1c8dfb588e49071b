"""Figure 8: one moment, seen with all cameras, and without each."""

from dataclasses import replace
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import torch

from lss_core.config import CAMERAS
from robustness_table.asking import SPLIT
from shoot.prediction.disturbance import Disturbance
from shoot.prediction.segmenter import TrainedSegmenter, open_segmenter, segment_batches
from shoot.rendering import save_figure
from shoot.rendering.segmentation_figure import draw_classes
from shoot.training.segmentation.data import SegmentSplit


def draw_missing(folder: Path, path: Path) -> None:
    """The truth, the map as the run sees it, and as it does without each camera.

    The moment is the validation sample with the most cells of its first class.

    Args:
        folder: Of the run.
        path: Of the picture.
    """
    run = open_segmenter(folder)
    samples = run.task.load_split(run.config.data, SPLIT)
    position, truth = _fullest(samples)
    maps = {"truth": truth, "all cameras": _seen(run, samples, position)}
    for name in CAMERAS:
        hidden = replace(run, disturbance=Disturbance(missing=(name,)))
        label = name.removeprefix("CAM_").replace("_", " ").lower()
        maps[f"without {label}"] = _seen(hidden, samples, position)
    figure, panels = plt.subplots(2, 4, figsize=(12.0, 6.4))
    for axes, (title, values) in zip(panels.flat, maps.items(), strict=True):
        draw_classes(axes, run.config.model.grid, run.config.classes, values)
        axes.set_title(title, fontsize=11)
        axes.set(xticks=[], yticks=[])
    figure.tight_layout()
    save_figure(figure, path, dpi=100.0)
    plt.close(figure)


def _fullest(samples: SegmentSplit) -> tuple[int, np.ndarray]:
    labels = (samples.labels.read(int(row)) for row in samples.rows)
    counts = [int(of_sample[0].sum()) for of_sample in labels]
    position = int(np.argmax(counts))
    return position, samples.labels.read(int(samples.rows[position])).astype(np.float64)


def _seen(run: TrainedSegmenter, samples: SegmentSplit, position: int) -> np.ndarray:
    batch = next(iter(segment_batches(run, samples, np.array([position]))))
    with torch.no_grad():
        prob: np.ndarray = run.module(batch.sensors).sigmoid()[0].double().cpu().numpy()
    return prob
