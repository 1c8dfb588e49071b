"""What an evaluation of a segmentation found, and the plain values of its report.json."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Final

from lss_core.strict_json import save_json
from shoot.metrics.bootstrap import Groups, Interval
from shoot.metrics.overlap import THRESHOLD

TASK: Final = "segmentation"


@dataclass(frozen=True)
class ClassScores:
    """How well one class is found, over all cells of all samples; all but thresholds in per cent.

    Attributes:
        iou: One intersection over one union, where a cell counts as found from 0.5 on.
        best_threshold: The one with the highest IoU on these very samples.
        iou_at_best: IoU there; each draw of scenes has its own best.
        average_precision: Area under precision over recall.
        share_true: Cells of the class among all: the IoU of marking every cell.
    """

    iou: Interval
    best_threshold: float
    iou_at_best: Interval
    average_precision: Interval
    share_true: float

    def to_json(self) -> dict[str, Any]:
        """Plain values."""
        return asdict(self)


@dataclass(frozen=True)
class Part:
    """Some of the samples, or some of their cells.

    Attributes:
        num_samples: Samples.
        num_scenes: Scenes they come from.
        iou: Class -> IoU at 0.5 in per cent.
    """

    num_samples: int
    num_scenes: int
    iou: dict[str, Interval]

    def to_json(self) -> dict[str, Any]:
        """Plain values."""
        return {
            "num_samples": self.num_samples,
            "num_scenes": self.num_scenes,
            "classes": {name: {"iou": asdict(iou)} for name, iou in self.iou.items()},
        }


@dataclass(frozen=True)
class SceneCounts:
    """One scene, as two reports are compared by it.

    Attributes:
        num_samples: Samples.
        classes: Class -> `true_positives`, `false_positives`, `false_negatives`: cells at 0.5.
        log: Its log, where logs hold several scenes.
    """

    num_samples: int
    classes: dict[str, dict[str, int]]
    log: str | None = None

    def to_json(self) -> dict[str, Any]:
        """Plain values; no log where there is none to be told."""
        return {key: value for key, value in asdict(self).items() if value is not None}


@dataclass(frozen=True)
class SegmentationReport:
    """What `shoot-evaluate` has to say of a segmentation.

    Attributes:
        split: Name of the split.
        rule: Which cells are of a class, as the labels have it.
        cell_m: Side of a cell in metres.
        num_samples: Samples.
        num_scenes: Scenes they come from.
        num_groups: What intervals are over: these scenes, or the logs they come from.
        classes: Class -> scores of the model.
        baselines: Baseline -> class -> its scores.
        differences: Baseline -> class -> metric -> model minus baseline, with paired interval.
        by_distance: The cells of each ring around the car.
        by_condition: The samples of each condition (day, night, ...) that occurs.
        by_scene: Scene -> its counts.
        resampled: What intervals are over.
        num_bad_samples: Samples left out because they cannot be used.
        num_seen_scenes: Scenes that the run was trained on.
    """

    split: str
    rule: str
    cell_m: float
    num_samples: int
    num_scenes: int
    num_groups: int
    classes: dict[str, ClassScores]
    by_distance: dict[str, Part]
    by_condition: dict[str, Part]
    by_scene: dict[str, SceneCounts]
    baselines: dict[str, dict[str, ClassScores]] = field(default_factory=dict)
    differences: dict[str, dict[str, dict[str, Interval]]] = field(default_factory=dict)
    resampled: Groups = "scenes"
    num_bad_samples: int = 0
    num_seen_scenes: int = 0

    def to_json(self) -> dict[str, Any]:
        """The form of report.json."""
        return {
            "task": TASK,
            "split": self.split,
            "rule": self.rule,
            "cell_m": self.cell_m,
            "threshold": THRESHOLD,
            "resampled": self.resampled,
            "num_samples": self.num_samples,
            "num_scenes": self.num_scenes,
            "num_groups": self.num_groups,
            "num_bad_samples": self.num_bad_samples,
            "num_seen_scenes": self.num_seen_scenes,
            "classes": _plain(self.classes),
            "baselines": {name: _plain(classes) for name, classes in self.baselines.items()},
            "differences": {
                name: {
                    of_class: {metric: asdict(interval) for metric, interval in metrics.items()}
                    for of_class, metrics in classes.items()
                }
                for name, classes in self.differences.items()
            },
            "by_distance": _plain(self.by_distance),
            "by_condition": _plain(self.by_condition),
            "by_scene": _plain(self.by_scene),
        }

    def save(self, path: str | Path) -> None:
        """Write report.json; what does not exist (a bound with one group only) is null.

        Raises:
            OSError: If it cannot be written.
        """
        save_json(self.to_json(), path)


def _plain(parts: Mapping[str, ClassScores | Part | SceneCounts]) -> dict[str, dict[str, Any]]:
    return {name: part.to_json() for name, part in parts.items()}
