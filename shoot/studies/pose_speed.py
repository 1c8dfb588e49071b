"""Does a camera planner read the car's speed from the poses of its cameras?

Cameras fire one after the other. Where poses say where each was then, they hold how far the car
drove in between. The planner is asked with poses as recorded, and with those of a car that drives
straight ahead at a speed of our choice. Images stay as they are.
"""

from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float, Int

from lss_core.batch import Batch
from lss_core.data.samples import SampleIndex
from lss_core.errors import DataError
from lss_core.geometry import FloatArray
from lss_core.progress import progress
from lss_core.strict_json import save_json
from shoot.metrics.bootstrap import GroupBootstrap, Groups, Interval
from shoot.metrics.ranks import negative_log_likelihood, rank_labels
from shoot.prediction.run import TrainedRun, batches
from shoot.training.planning.data import LabelledSplit

Array = np.ndarray[Any, np.dtype[Any]]

SPEEDS_MPS = (0.0, 5.0, 10.0, 15.0)
RECORDED = "as recorded"
POSES: dict[str, float | None] = {RECORDED: None} | {f"at {v:g} m/s": v for v in SPEEDS_MPS}
_CHANGED = tuple(name for name in POSES if name != RECORDED)
# What is planned, and what was driven, is compared by the mean speed of the first second.
_BEGIN_S = 1.0


@dataclass(frozen=True)
class PoseSpeedStudy:
    """What came out; all by which poses the planner was given.

    Attributes:
        num_samples, num_scenes: Asked about.
        resampled, num_groups: What intervals are over.
        driven_mps: Mean speed that was driven in the first second.
        planned_mps: Mean speed that was planned for it, over templates and samples.
        correlation: Of the two, over samples.
        top10: Accuracy, per cent.
        nll: In nats.
        top10_change, nll_change: Minus those with poses as recorded, paired.
    """

    num_samples: int
    num_scenes: int
    resampled: Groups
    num_groups: int
    driven_mps: Interval
    planned_mps: dict[str, Interval]
    correlation: dict[str, Interval]
    top10: dict[str, Interval]
    nll: dict[str, Interval]
    top10_change: dict[str, Interval]
    nll_change: dict[str, Interval]

    def save(self, path: Path) -> None:
        """Write it as JSON."""
        save_json(asdict(self), path)


def poses_at(index: SampleIndex, row: int, speed_mps: float) -> FloatArray:
    """[N, 4, 4] ego_from_camera of a car that drives straight ahead while its cameras fire.

    Args:
        index: Of the samples.
        row: Which sample.
        speed_mps: How fast.
    """
    poses: FloatArray = index.egocam_from_camera[row].copy()
    poses[:, 0, 3] += speed_mps * (index.camera_time_s[row] - index.time_s[row])
    return poses


def study_pose_speed(
    run: TrainedRun, split: LabelledSplit, num_samples: int = 400
) -> PoseSpeedStudy:
    """Ask a camera planner, with each kind of poses, about samples evenly spread over a split.

    Raises:
        DataError: If it reads lidar, or does not read poses at each camera's own time.
    """
    data = run.config.data
    if data.lidar_scans or not data.ego_motion:
        raise DataError(
            "Speed in poses is studied on camera planners that read each camera's pose at its own "
            "time; this run reads lidar, or poses as mounted."
        )
    count = min(num_samples, len(split.labels))
    positions = np.linspace(0, len(split.labels) - 1, count).round().astype(np.int64)
    log_probs: dict[str, list[Array]] = {name: [] for name in POSES}
    with progress("Studying speed in poses", count) as advance, torch.no_grad():
        for batch in batches(run, split, positions):
            for name, speed_mps in POSES.items():
                sensors = _with_poses(batch.sensors, split.index, speed_mps)
                log_prob = run.module(sensors).log_softmax(dim=-1)
                log_probs[name].append(log_prob.float().cpu().numpy())
            advance(len(batch.template_idx))
    step = round(_BEGIN_S / run.templates.dt_s) - 1
    return _summary(
        {name: np.concatenate(parts) for name, parts in log_probs.items()},
        split.labels[positions],
        _speeds(run.templates.points, step),
        _speeds(split.futures.xy_m[positions], step),
        split.futures.scene[positions],
        None if split.logs is None else split.logs[positions],
    )


def _speeds(points_m: Float[Array, "P T 2"], step: int) -> Float[Array, " P"]:
    """Mean speed until a step, as the crow flies."""
    speeds: Array = np.linalg.norm(points_m[:, step], axis=-1) / _BEGIN_S
    return speeds


def _with_poses(sensors: Batch, index: SampleIndex, speed_mps: float | None) -> Batch:
    if speed_mps is None:
        return sensors
    rows = sensors.sample_idx.tolist()
    poses = np.stack([poses_at(index, row, speed_mps) for row in rows])
    return replace(sensors, ego_from_camera=torch.from_numpy(poses).to(sensors.ego_from_camera))


def _summary(
    log_probs: dict[str, Float[Array, "S K"]],
    labels: Int[Array, " S"],
    template_mps: Float[Array, " K"],
    driven_mps: Float[Array, " S"],
    scene: Int[Array, " S"],
    logs: Array | None,
) -> PoseSpeedStudy:
    bootstrap = GroupBootstrap(scene if logs is None else logs)
    planned = {name: np.exp(rows) @ template_mps for name, rows in log_probs.items()}
    top10 = {name: 100.0 * rank_labels(rows, labels).hits(10) for name, rows in log_probs.items()}
    nll = {name: negative_log_likelihood(rows, labels) for name, rows in log_probs.items()}
    return PoseSpeedStudy(
        num_samples=len(labels),
        num_scenes=len(np.unique(scene)),
        resampled="scenes" if logs is None else "logs",
        num_groups=bootstrap.num_groups,
        driven_mps=bootstrap.interval(driven_mps),
        planned_mps={name: bootstrap.interval(values) for name, values in planned.items()},
        correlation={
            name: _correlation(bootstrap, values, driven_mps) for name, values in planned.items()
        },
        top10={name: bootstrap.interval(values) for name, values in top10.items()},
        nll={name: bootstrap.interval(values) for name, values in nll.items()},
        top10_change={n: bootstrap.interval(top10[n] - top10[RECORDED]) for n in _CHANGED},
        nll_change={n: bootstrap.interval(nll[n] - nll[RECORDED]) for n in _CHANGED},
    )


def _correlation(
    bootstrap: GroupBootstrap, x: Float[Array, " S"], y: Float[Array, " S"]
) -> Interval:
    """Pearson's, from sums over samples."""
    x, y = x - x.mean(), y - y.mean()  # means of a draw still differ from 0: they are in the sums
    sums = np.stack([np.ones_like(x), x, y, x * x, y * y, x * y], axis=1)

    def of_sums(total: Float[Array, "D 6"]) -> Float[Array, " D"]:
        n, sx, sy, sxx, syy, sxy = total.T
        with np.errstate(invalid="ignore"):
            found: Array = (n * sxy - sx * sy) / np.sqrt((n * sxx - sx**2) * (n * syy - sy**2))
        return found

    return bootstrap.statistic(sums, of_sums)


def format_pose_speed(study: PoseSpeedStudy) -> str:
    """It as a table in Markdown, with a line above."""
    lines = [
        f"{study.num_samples} samples of {study.num_scenes} scenes; driven in the first second: "
        f"{_cell(study.driven_mps, '.1f')} m/s.",
        "",
        "| poses | planned, m/s | correlation with driven | top-10, % | NLL, nats | change of "
        "top-10 | of NLL |",
        "| --- | --- | --- | --- | --- | --- | --- |",
    ]
    for name in POSES:
        changes = ["", ""]
        if name in _CHANGED:
            changes = [
                _cell(study.top10_change[name], "+.1f"),
                _cell(study.nll_change[name], "+.2f"),
            ]
        cells = (
            name,
            _cell(study.planned_mps[name], ".1f"),
            _cell(study.correlation[name], ".2f"),
            _cell(study.top10[name], ".1f"),
            _cell(study.nll[name], ".2f"),
            *changes,
        )
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def _cell(interval: Interval, form: str) -> str:
    value, low, high = (format(x, form) for x in (interval.value, interval.low, interval.high))
    return f"{value} [{low}, {high}]"
