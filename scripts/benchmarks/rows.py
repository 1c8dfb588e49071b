"""Makers of the table's rows: what is timed against what, and what must hold."""

import tempfile
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import numpy as np
import torch

from benchmarks import big_tables, fitting, learning, lift_splat, loading, planning
from benchmarks.driving import drive_rows
from benchmarks.index_rows import index_rows
from benchmarks.measuring import Pair, Side, Spread, compare, measured
from benchmarks.row import Check, Row, Setting
from shoot.training.precision import fastest_precision


def splat_rows(setting: Setting) -> Iterator[Row]:
    """Lift and splat, batch 4."""
    plain = "cumulative sum, analytic gradient, float32"
    bytes_moved = _splat_bytes()
    once = bytes_moved / setting.machine.copied_bytes_s
    yield Row(
        "lift and splat, forward and backward, new calibration",
        plain,
        "embedding bag, index built anew",
        compare(
            lift_splat.plain_training,
            lift_splat.fast_training_new,
            setting.repeats,
            fast_calls=3,
        ),
        8.0,
        3 * once,
    )
    pair = compare(
        lift_splat.plain_training,
        lift_splat.fast_training_static,
        setting.repeats,
        fast_calls=3,
    )
    share = pair.fast_mb / pair.plain_mb
    yield Row(
        "lift and splat, forward and backward, calibration unchanged",
        plain,
        "embedding bag",
        pair,
        8.0,
        3 * once,
        (Check(f"memory {share:.2f} of the plain side's (at most 0.25)", share <= 0.25),),
    )
    sides = lift_splat.plain_forward()(), lift_splat.fast_forward_static()()
    error = float((sides[0] - sides[1]).abs().max() / sides[0].abs().max())
    yield Row(
        "lift and splat, forward, calibration unchanged",
        plain,
        "embedding bag",
        compare(
            lift_splat.plain_forward,
            lift_splat.fast_forward_static,
            setting.repeats,
            fast_calls=5,
        ),
        15.0,
        once,
        (Check(f"largest difference {error:.0e} of the largest value", error < 1e-4),),
    )


def _splat_bytes() -> int:
    """Bytes that must be moved to splat a batch: features once, points once, the map once."""
    context, depth_prob = lift_splat.features()
    cells = lift_splat.NUM_SAMPLES * 200 * 200 * context.shape[2] * 4
    return context.nbytes + 2 * depth_prob.nbytes + cells


# Least ratios of the whole planner and of a step, most of whose gain is bfloat16: without units for
# it, what both sides spend their time on are the same convolutions.
_PLAN = {"bf16-mixed": 7.0, "32-true": 1.5}
_STEP = {"bf16-mixed": 3.0, "32-true": 0.9}


def plan_rows(setting: Setting) -> Iterator[Row]:
    """Images of one sample to probabilities."""
    data = setting.folder / "learning"
    learning.make_data(data)
    precision = fastest_precision(torch.device("cpu"))
    paper = learning.agreement(learning.train_paper_size(data, precision), 60)
    learning.loss_after(data, precision, 0)
    small = learning.agreement(data / f"{precision}-0", 200)
    checks = [
        Check(
            f"{name}: {100 * found.overlap:.1f} % of the ten most probable templates are the same "
            f"(at least 99), a probability changes by at most {found.largest_change:.4f}, "
            f"{found.num_samples} samples",
            found.overlap >= 0.99,
        )
        for name, found in (("this planner after 40 steps", paper), ("demo preset", small))
    ]
    with tempfile.TemporaryDirectory() as folder:
        first = partial(planning.first_plan, Path(folder))
        compiling_s = [measured(first)[0] for _ in range(2)]
    checks.append(
        Check(
            f"the first call compiles, {compiling_s[0]:.0f} s; in later processes it takes "
            f"{compiling_s[1]:.0f} s",
            True,
        )
    )
    uncompiled = Side(planning.uncompiled_plan)
    uncompiled.seconds()
    checks.append(Check(f"uncompiled {uncompiled.seconds(5):.3f} s", True))
    uncompiled.close()
    yield Row(
        "images to probabilities, one sample",
        "float32, contiguous, cumulative sum",
        "FastPlanner",
        compare(planning.plain_plan, planning.fast_plan, setting.repeats, fast_calls=3),
        _PLAN[precision],
        planning.plan_flop() / setting.machine.best_flops,
        tuple(checks),
    )


def export_rows(setting: Setting) -> Iterator[Row]:
    """Images of one sample to probabilities, in another runtime."""
    change, largest = planning.onnx_change()
    yield Row(
        "images to probabilities by onnxruntime, one sample",
        "FastPlanner",
        "the exported ONNX file in float32, splat index kept",
        compare(planning.fast_plan, planning.onnx_plan, setting.repeats, 3, 3),
        0.0,  # stated, not asked for: the runtime is not ours
        planning.plan_flop() / setting.machine.float32_flops,
        (
            Check(
                f"a probability is at most {change:.0e} off PyTorch's in float32 (at most 1e-4); "
                f"the largest is {largest:.2f}",
                change <= 1e-4,
            ),
        ),
    )


def step_rows(setting: Setting) -> Iterator[Row]:
    """A training step, batch 4."""
    data = setting.folder / "learning"
    learning.make_data(data)
    fast = fastest_precision(torch.device("cpu"))
    plain_losses = [learning.loss_after(data, "32-true", seed) for seed in learning.SEEDS]
    fast_losses = [learning.loss_after(data, fast, seed) for seed in learning.SEEDS]
    spread = max(plain_losses) - min(plain_losses)
    apart = abs(float(np.mean(fast_losses) - np.mean(plain_losses)))
    losses = [", ".join(f"{loss:.3f}" for loss in side) for side in (plain_losses, fast_losses)]
    yield Row(
        "training step, batch 4",
        "float32, contiguous, cumulative sum",
        f"as shoot-train does it ({fast})",
        compare(planning.plain_step, planning.fast_step, max(3, setting.repeats // 2)),
        _STEP[fast],
        planning.step_flop() / setting.machine.best_flops,
        (
            Check(
                f"validation loss after {learning.STEPS} steps of the demo preset, three seeds: "
                f"float32 {losses[0]}; {fast} {losses[1]}; means {apart:.3f} apart (at most the "
                f"spread of float32, {spread:.3f})",
                apart <= spread,
            ),
        ),
    )


def loader_rows(setting: Setting) -> Iterator[Row]:
    """One sample's images, on one core."""
    root = setting.images or loading.make_images(setting.folder / "images")
    version = setting.images_version if setting.images else big_tables.VERSION
    levels = loading.difference(root, version)
    normalising_ms = 1e3 * loading.normalising_s(root, version)
    mean, high = float(levels.mean()), float(np.quantile(levels, 0.999))
    yield Row(
        "six 1600 x 900 JPEGs to a network's input, one core",
        "decoded and resized whole, normalised floats",
        "decoded at reduced scale, resized where kept, bytes",
        compare(
            partial(loading.plain_load, root, version),
            partial(loading.fast_load, root, version),
            4 * setting.repeats,
        ),
        4.0,
        None,
        (
            Check(
                f"pixels differ by {mean:.2f} of 255 levels on average (at most 2), 99.9 % by at "
                f"most {high:.0f}",
                mean <= 2.0,
            ),
            Check(
                f"the fast side's bytes become floats in the network, {normalising_ms:.1f} ms a "
                "sample on one core, not counted here",
                True,
            ),
        ),
    )


def fit_rows(setting: Setting) -> Iterator[Row]:
    """1000 templates of 200,000 futures."""
    plain, fast, stream = (
        Side(prepare) for prepare in (fitting.plain_fit, fitting.fast_fit, fitting.stream_fit)
    )
    try:
        times: list[tuple[float, float]] = []
        for _ in range(max(2, setting.repeats // 3)):
            times.append((plain.seconds(), fast.seconds()))
        stream_s = stream.seconds()
        inertia = [side.result().inertia for side in (plain, fast, stream)]
        given_up = stream.result().given_up
        pair = Pair(
            Spread.of([p for p, _ in times]),
            Spread.of([f for _, f in times]),
            Spread.of([p / f for p, f in times]),
            plain.peak_mb(),
            fast.peak_mb(),
        )
    finally:
        for side in (plain, fast, stream):
            side.close()
    more, more_stream = inertia[1] / inertia[0] - 1.0, inertia[2] / inertia[0] - 1.0
    yield Row(
        "1000 templates of 200,000 futures",
        "scikit-learn's KMeans as it comes",
        "from coarse to fine",
        pair,
        3.0,
        None,
        (
            Check(f"inertia {100 * more:+.2f} % (at most +1)", more <= 0.01),
            Check(
                f"as a stream {stream_s:.1f} s, inertia {100 * more_stream:+.1f} %, which it puts "
                f"at no more than {100 * given_up:+.1f} %",
                more_stream <= given_up,
            ),
        ),
    )


ROWS: dict[str, Callable[[Setting], Iterator[Row]]] = {
    "splat": splat_rows,
    "plan": plan_rows,
    "export": export_rows,
    "step": step_rows,
    "loader": loader_rows,
    "fit": fit_rows,
    "index": index_rows,
    "drive": drive_rows,
}
