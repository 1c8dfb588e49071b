"""How well a camera planner sees depth, and what it would plan if the lidar told it.

A test of what limits it: where lidar points fall into a feature cell, the network's distribution
over depths gives way to the depth of the nearest of them.
"""

import io
import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float, Int, Shaped
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table
from torch import Tensor

from lss_core.batch import Batch
from lss_core.data.sensors.lidar import load_sweep
from lss_core.depth_targets import depth_bins, nearest_depths
from lss_core.errors import DataError
from lss_core.files import write_atomically
from lss_core.model import CameraModel
from lss_core.progress import progress
from lss_core.splat import pool
from shoot.metrics.bootstrap import GroupBootstrap, Groups, Interval, name_groups
from shoot.metrics.ranks import negative_log_likelihood, rank_labels
from shoot.prediction.run import TrainedRun, batches
from shoot.training.planning.data import LabelledSplit

Array = np.ndarray[Any, np.dtype[Any]]

# What the planner is given for depth: its own, the lidar's where it sees, the same everywhere.
DEPTHS = ("own", "lidar", "flat")
RANGES_M = ((4.0, 10.0), (10.0, 20.0), (20.0, 30.0), (30.0, 46.0))


@dataclass(frozen=True)
class DepthStudy:
    """What came out.

    Attributes:
        num_samples, num_scenes: Asked about.
        resampled, num_groups: What intervals are over.
        cells_seen: Share of feature cells in which the lidar sees something, per cent.
        error_m: Range of true depths -> distance from the network's mean depth to the lidar's.
        bias_m: The same with its sign; positive: the network sees it further away.
        top10: What it is given -> top-10 accuracy, per cent.
        nll: Likewise, in nats.
        top10_change, nll_change: `lidar` and `flat` minus its own, paired.
    """

    num_samples: int
    num_scenes: int
    resampled: Groups
    num_groups: int
    cells_seen: float
    error_m: dict[str, Interval]
    bias_m: dict[str, Interval]
    top10: dict[str, Interval]
    nll: dict[str, Interval]
    top10_change: dict[str, Interval]
    nll_change: dict[str, Interval]

    def save(self, path: Path) -> None:
        """Write it as JSON."""
        with write_atomically(path) as stream:
            stream.write((json.dumps(asdict(self), indent=2) + "\n").encode())


def tell_depth(
    depth_prob: Float[Tensor, "N D H W"],
    true_m: Float[Tensor, "N H W"],
    depths_m: tuple[float, ...],
) -> Float[Tensor, "N D H W"]:
    """The distribution with all its mass at the true depth's bin, where that is known.

    Depths beyond the first or last bin by more than half a step stay as they were: no bin is right.
    """
    bins = depth_bins(true_m, depths_m)
    one_hot = torch.nn.functional.one_hot(bins.clamp(min=0), num_classes=len(depths_m))
    return torch.where(bins[:, None] >= 0, one_hot.movedim(-1, 1).to(depth_prob.dtype), depth_prob)


def study_depth(run: TrainedRun, split: LabelledSplit, num_samples: int = 400) -> DepthStudy:
    """Ask a camera planner, with each kind of depth, about samples evenly spread over a split.

    Raises:
        DataError: If the planner learns no depth, or a file is missing or damaged.
    """
    model = run.module.model
    if not isinstance(model, CameraModel) or model.config.lift != "depth":
        raise DataError(
            "Depth is studied on camera planners that learn it (lift 'depth'); this run reads "
            "lidar, or images in another way."
        )
    count = min(num_samples, len(split.labels))
    positions = np.linspace(0, len(split.labels) - 1, count).round().astype(np.int64)
    labels, scene = split.labels[positions], split.futures.scene[positions]
    logs = None if split.logs is None else split.logs[positions]
    log_probs: dict[str, list[Array]] = {name: [] for name in DEPTHS}
    errors, seen = np.full((2, count, len(RANGES_M)), np.nan), np.zeros(count)
    done = 0
    with progress("Studying depth", count) as advance:
        for batch in batches(run, split, positions):
            for b in range(len(batch.template_idx)):
                told, true_m, own_m = _ask(run, split, batch.sensors, b)
                for name, log_prob in told.items():
                    log_probs[name].append(log_prob)
                seen[done] = 100.0 * np.isfinite(true_m).mean()
                for column, (low_m, high_m) in enumerate(RANGES_M):
                    off_m = (own_m - true_m)[(true_m >= low_m) & (true_m < high_m)]
                    if len(off_m):
                        errors[:, done, column] = np.abs(off_m).mean(), off_m.mean()
                done += 1
                advance(1)
    return _summary(
        {name: np.stack(rows) for name, rows in log_probs.items()},
        labels,
        scene,
        logs,
        errors,
        seen,
    )


@torch.no_grad()
def _ask(
    run: TrainedRun, split: LabelledSplit, sensors: Batch, b: int
) -> tuple[dict[str, Array], Array, Array]:
    """Log-probabilities by kind of depth; true and mean predicted depth of each cell, metres."""
    model = run.module.model
    assert isinstance(model, CameraModel)
    one = slice(b, b + 1)
    pixel_from_camera, poses = sensors.pixel_from_camera[one], sensors.ego_from_camera[one]
    mask = sensors.camera_mask[one]
    points = load_sweep(split.index, Path(run.config.data.root), int(sensors.sample_idx[b]))
    true_m = nearest_depths(
        torch.from_numpy(points).to(poses),
        pixel_from_camera[0],
        poses[0],
        model.image_hw,
        model.config.image_stride,
    )
    context, depth_prob = model.encode_images(sensors.images[one], mask)
    depths_m = model.config.depth.depths_m
    kinds = {
        "own": depth_prob[0],
        "lidar": tell_depth(depth_prob[0], true_m, depths_m),
        "flat": torch.full_like(depth_prob[0], 1.0 / len(depths_m)),
    }
    index = model.splat_index(pixel_from_camera, poses, mask)
    answers = {}
    for name, prob in kinds.items():
        bev = pool(context, prob[None], index, model.config.grid)
        scores = run.module.outputs(model.bev_encoder(bev))
        answers[name] = scores.log_softmax(dim=-1)[0].float().cpu().numpy()
    mean_m = torch.einsum("ndhw,d->nhw", depth_prob[0], depth_prob.new_tensor(depths_m))
    return answers, true_m.cpu().numpy(), mean_m.cpu().numpy()


def _summary(
    log_probs: dict[str, Float[Array, "S K"]],
    labels: Int[Array, " S"],
    scene: Int[Array, " S"],
    logs: Shaped[Array, " S"] | None,
    errors: Float[Array, "2 S R"],
    seen: Float[Array, " S"],
) -> DepthStudy:
    bootstrap = GroupBootstrap(scene if logs is None else logs)
    top10 = {name: 100.0 * rank_labels(rows, labels).hits(10) for name, rows in log_probs.items()}
    nll = {name: negative_log_likelihood(rows, labels) for name, rows in log_probs.items()}
    names = [f"{low_m:g}-{high_m:g} m" for low_m, high_m in RANGES_M]
    error_m, bias_m = (
        {name: bootstrap.interval(own[:, column]) for column, name in enumerate(names)}
        for own in errors
    )
    others = [name for name in DEPTHS if name != "own"]
    return DepthStudy(
        num_samples=len(labels),
        num_scenes=len(np.unique(scene)),
        resampled="scenes" if logs is None else "logs",
        num_groups=bootstrap.num_groups,
        cells_seen=float(seen.mean()),
        error_m=error_m,
        bias_m=bias_m,
        top10={name: bootstrap.interval(values) for name, values in top10.items()},
        nll={name: bootstrap.interval(values) for name, values in nll.items()},
        top10_change={o: bootstrap.interval(top10[o] - top10["own"]) for o in others},
        nll_change={o: bootstrap.interval(nll[o] - nll["own"]) for o in others},
    )


def format_depth_study(study: DepthStudy) -> str:
    """It as text for a terminal."""
    ranges = Table(
        title=f"{study.num_samples} samples of {study.num_scenes} scenes; the lidar sees "
        f"{study.cells_seen:.0f} % of the feature cells (95 % intervals over "
        f"{name_groups(study.resampled, study.num_groups)})",
        box=SIMPLE_HEAD,
    )
    for header in ("true depth", "error, m", "bias, m"):
        ranges.add_column(header)
    for name, error_m in study.error_m.items():
        ranges.add_row(name, _cell(error_m, "{:.2f}"), _cell(study.bias_m[name], "{:+.2f}"))
    plans = Table(box=SIMPLE_HEAD)
    for header in ("depth given", "top-10, %", "NLL, nats", "change of top-10", "of NLL"):
        plans.add_column(header)
    for name in DEPTHS:
        changes = ["", ""]
        if name in study.nll_change:
            changes = [
                _cell(study.top10_change[name], "{:+.1f}"),
                _cell(study.nll_change[name], "{:+.2f}"),
            ]
        plans.add_row(
            name, _cell(study.top10[name], "{:.1f}"), _cell(study.nll[name], "{:.2f}"), *changes
        )
    console = Console(file=io.StringIO(), width=120, color_system=None)
    with console.capture() as captured:
        console.print(ranges, plans)
    return "\n".join(line.rstrip() for line in captured.get().splitlines()).strip("\n")


def _cell(interval: Interval, form: str) -> str:
    value, low, high = (form.format(x) for x in (interval.value, interval.low, interval.high))
    return f"{value} \\[{low}, {high}]"  # rich reads square brackets
