"""From counts of cells to a report with intervals over scenes."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int, Shaped

from lss_core.grid import BevGrid
from shoot.evaluation.segmentation.counting import CellCounts, name_rings
from shoot.evaluation.segmentation.results import (
    ClassScores,
    Part,
    SceneCounts,
    SegmentationReport,
)
from shoot.metrics.bootstrap import GroupBootstrap, Interval
from shoot.metrics.overlap import (
    average_precision,
    best_threshold,
    count_overlap,
    iou,
    iou_at_best,
    share_true,
)

Array = np.ndarray[Any, np.dtype[Any]]
_Metric = Callable[[Float[Array, "D J 2"]], Float[Array, " D"]]

_METRICS: dict[str, _Metric] = {
    "iou": lambda counts: iou(count_overlap(counts)),
    "iou_at_best": iou_at_best,
    "average_precision": average_precision,
}


def summarise(
    counts: CellCounts,
    classes: Sequence[str],
    grid: BevGrid,
    split: str,
    scene_names: Sequence[str],
    conditions: Sequence[str],
    logs: Sequence[str] | None = None,
    baselines: Mapping[str, CellCounts] | None = None,
    rule: str = "centre",
) -> SegmentationReport:
    """Scores with intervals, overall and split up.

    Args:
        counts: Of N scenes.
        classes: Names of the channels.
        grid: Cells of the maps.
        split: Name of the split, for the report.
        scene_names: Name of each scene.
        conditions: Condition of each scene, see `condition_of`.
        logs: Log of each scene, where logs hold several scenes; intervals are then over logs.
        baselines: Baseline -> its counts of the same scenes.
        rule: Which cells are of a class, for the report.

    Raises:
        ValueError: If names, conditions or counts of baselines are of other numbers of scenes.
    """
    num_scenes, others = len(counts.scene), baselines or {}
    sizes = {len(scene_names), len(conditions), *(len(it.scene) for it in others.values())}
    sizes |= set() if logs is None else {len(logs)}
    if sizes != {num_scenes}:
        raise ValueError(f"All must be of {num_scenes} scenes, got {sorted(sizes)}.")
    group = np.array(scene_names if logs is None else logs)
    bootstrap = GroupBootstrap(group)
    overlap = count_overlap(counts.by_probability)

    def part(keep: Bool[Array, " N"], cells: Int[Array, "N C 3"]) -> Part:
        return Part(
            int(counts.num_samples[keep].sum()),
            int(keep.sum()),
            _iou_by_class(cells[keep], group[keep], classes),
        )

    everywhere = np.ones(num_scenes, dtype=bool)
    return SegmentationReport(
        split=split,
        rule=rule,
        cell_m=grid.cell_m,
        num_samples=int(counts.num_samples.sum()),
        num_scenes=num_scenes,
        num_groups=bootstrap.num_groups,
        classes=_score_classes(bootstrap, counts, classes),
        baselines={name: _score_classes(bootstrap, it, classes) for name, it in others.items()},
        differences={
            name: _differences(bootstrap, counts, it, classes) for name, it in others.items()
        },
        by_distance={
            name: part(everywhere, counts.by_ring[:, :, ring])
            for ring, name in enumerate(name_rings(grid))
        },
        by_condition={
            name: part(np.array([it == name for it in conditions]), overlap)
            for name in sorted(set(conditions))
        },
        by_scene={
            name: SceneCounts(
                int(counts.num_samples[n]),
                {one: _named(overlap[n, c]) for c, one in enumerate(classes)},
                None if logs is None else logs[n],
            )
            for n, name in enumerate(scene_names)
        },
        resampled="scenes" if logs is None else "logs",
    )


def _score_classes(
    bootstrap: GroupBootstrap, counts: CellCounts, classes: Sequence[str]
) -> dict[str, ClassScores]:
    found = {}
    for c, name in enumerate(classes):
        cells = counts.by_probability[:, c]
        metrics = {key: _interval(bootstrap, cells, metric) for key, metric in _METRICS.items()}
        total = cells.sum(axis=0)
        found[name] = ClassScores(
            **metrics, best_threshold=best_threshold(total), share_true=float(share_true(total))
        )
    return found


def _interval(bootstrap: GroupBootstrap, cells: Int[Array, "N J 2"], metric: _Metric) -> Interval:
    def of_sums(sums: Float[Array, "D JJ"]) -> Float[Array, " D"]:
        return metric(sums.reshape(len(sums), -1, 2))

    return bootstrap.statistic(cells.reshape(len(cells), -1).astype(np.float64), of_sums)


def _differences(
    bootstrap: GroupBootstrap, ours: CellCounts, theirs: CellCounts, classes: Sequence[str]
) -> dict[str, dict[str, Interval]]:
    """Model minus baseline in the same draws."""

    def difference(metric: _Metric) -> _Metric:
        def less(counts: Float[Array, "D J 2"]) -> Float[Array, " D"]:
            half = counts.shape[1] // 2
            one: Array = metric(counts[:, :half]) - metric(counts[:, half:])
            return one

        return less

    both = np.concatenate([ours.by_probability, theirs.by_probability], axis=2)
    return {
        name: {
            key: _interval(bootstrap, both[:, c], difference(metric))
            for key, metric in _METRICS.items()
        }
        for c, name in enumerate(classes)
    }


def _iou_by_class(
    overlap: Int[Array, "N C 3"], group: Shaped[Array, " N"], classes: Sequence[str]
) -> dict[str, Interval]:
    bootstrap = GroupBootstrap(group)
    return {
        name: bootstrap.statistic(overlap[:, c].astype(np.float64), iou)
        for c, name in enumerate(classes)
    }


def _named(overlap: Int[Array, "3"]) -> dict[str, int]:
    names = ("true_positives", "false_positives", "false_negatives")
    return dict(zip(names, overlap.tolist(), strict=True))
