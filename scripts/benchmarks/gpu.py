"""The table of a GPU: the reference splat's planner against ours on one card, in turn.

Of each pair both sides run in this process, on one device, which is waited for before a clock is
read. The plain sides are our own plain code, as elsewhere: float32, contiguous tensors, the paper's
cumulative sum (`lss_core.splat_reference`).
"""

import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from datetime import datetime, timezone
from itertools import cycle
from pathlib import Path
from typing import Any

import pytorch_lightning as pl
import torch
from torch import Tensor
from torch.utils.data import DataLoader

from benchmarks import paper_size, planning
from benchmarks.measuring import Pair, Spread
from benchmarks.row import Check, Row
from lss_core.batch import Batch
from lss_core.camera import frustum_points
from lss_core.splat import build_splat_index, pool
from lss_core.splat_reference import lift_splat_cumsum
from shoot.prediction.fast import FastPlanner
from shoot.templates import TemplateSet
from shoot.training.loop import make_trainer
from shoot.training.planning.config import TrainConfig
from shoot.training.planning.data import PlanBatch
from shoot.training.planning.run_folder import PlanningRun
from shoot.training.planning.task import PlanningModule

Call = Callable[[], Any]
_PLAIN = "float32, contiguous, cumulative sum"


@dataclass(frozen=True)
class Work:
    """What is timed, and how often.

    Attributes:
        device: `cuda`; `cpu` tries whether everything runs.
        config: Of the planner.
        compiled: Whether `FastPlanner` compiles.
        batch_size: Of steps and splats.
        repeats: Of each pair.
        calls: Per repeat, of which the mean counts.
        steps: Of training per repeat; a few before them warm up.
    """

    device: str
    config: TrainConfig = planning.CONFIG
    compiled: bool = True
    batch_size: int = planning.BATCH_SIZE
    repeats: int = 7
    calls: int = 20
    steps: int = 20

    def module(self) -> PlanningModule:
        """The planner before training, always the same."""
        torch.manual_seed(0)
        module = PlanningModule(self.config, TemplateSet.load(planning.TEMPLATES))
        return module.to(self.device)

    def sensors(self, num_samples: int) -> Batch:
        """Noise of the planner's image size, on the host."""
        batch = paper_size.batch(num_samples)
        image = self.config.data.image
        images = batch.images[..., : image.height_px, : image.width_px].contiguous()
        return replace(batch, images=images)


def card() -> str:
    """What the table was made on, and when: a line."""
    return (
        f"One {torch.cuda.get_device_name()}; torch {torch.__version__}, CUDA "
        f"{torch.version.cuda}; {datetime.now(timezone.utc).date()}\n"
    )


def gpu_rows(work: Work) -> dict[str, Callable[[], Iterator[Row]]]:
    """The groups of rows by name."""
    return {
        "splat": lambda: splat_rows(work),
        "plan": lambda: plan_rows(work),
        "step": lambda: step_rows(work),
    }


def plan_rows(work: Work) -> Iterator[Row]:
    """Images of one sample to probabilities."""
    module, sensors = work.module().eval(), work.sensors(1).to(work.device)
    planner = FastPlanner(module, work.compiled)
    others = cycle([replace(sensors, ego_from_camera=_moved(sensors, n)) for n in range(1, 9)])

    def probabilities(planned: Callable[[Batch], Tensor], seen: Callable[[], Batch]) -> Call:
        return torch.no_grad()(lambda: planned(seen()).softmax(dim=-1))

    def same() -> Batch:
        return sensors

    plain = probabilities(lambda seen: planning.plain_scores(module, seen), same)
    kept = probabilities(planner, same)
    change = float((kept() - plain()).abs().max())
    agrees = Check(f"a probability changes by at most {change:.4f} (at most 0.01)", change <= 0.01)
    yield Row(
        "images to probabilities, one sample",
        _PLAIN,
        f"FastPlanner, {'a CUDA graph' if planner.recorded else 'no CUDA graph'}, "
        f"{'compiled' if planner.compiled else 'not compiled'}",
        in_turn(work, plain, kept),
        12.0,
        checks=(agrees,),
    )
    yield Row(
        "the same, a new calibration at each call",
        "FastPlanner, calibration kept",
        "FastPlanner, calibration new: at most 1.5 times as long",
        in_turn(work, kept, probabilities(planner, lambda: next(others))),
        1.0 / 1.5,
    )
    yield Row(
        "the same, float32, nothing compiled or recorded",
        _PLAIN,
        "the planner's module as it is",
        in_turn(work, plain, probabilities(module, same)),
        1.0,
    )


def step_rows(work: Work) -> Iterator[Row]:
    """A training step in float32, on this device as `shoot-train` does it on it."""
    module = work.module()
    plain = planning.trained_step(
        module,
        lambda sensors: planning.plain_scores(module, sensors),
        work.sensors(work.batch_size).to(work.device),
    )
    for _ in range(3):
        plain()
    plain_s, fast_s, fast_mb = [], [], 0.0
    for _ in range(max(3, work.repeats // 2)):
        plain_s.append(_seconds(work, plain, work.steps))
        step_s, fast_mb = _shoot_train(work)
        fast_s.append(step_s)
    yield Row(
        f"training step, batch {work.batch_size}, float32",
        _PLAIN,
        "as shoot-train runs it, batches from the host included: at most 40 % as long",
        _pair(plain_s, fast_s, _peak_mb(work, plain), fast_mb),
        2.5,
    )


def splat_rows(work: Work) -> Iterator[Row]:
    """Lift and splat, and its index alone."""
    model, random = work.config.model, torch.Generator().manual_seed(0)
    sensors = work.sensors(work.batch_size).to(work.device)
    image = work.config.data.image
    image_hw = image.height_px, image.width_px
    places = (work.batch_size, 6), tuple(side // model.image_stride for side in image_hw)
    depths_m = torch.tensor(model.depth.depths_m, dtype=torch.float64, device=work.device)

    def noise(channels: int) -> Tensor:
        shape = (*places[0], *places[1], channels)
        drawn = torch.randn(shape, generator=random).to(work.device)
        return drawn.permute(0, 1, 4, 2, 3)  # channels innermost in memory

    context = noise(model.context_channels).requires_grad_()
    depth_prob = noise(len(depths_m)).softmax(dim=2).requires_grad_()
    shape = (work.batch_size, *model.grid.shape, model.context_channels)
    slope = torch.randn(shape, generator=random).to(work.device).permute(0, 3, 1, 2)

    def points() -> Tensor:
        return frustum_points(
            image_hw,
            model.image_stride,
            depths_m,
            sensors.pixel_from_camera,
            sensors.ego_from_camera,
        )

    def index() -> Any:
        return build_splat_index(points(), model.grid)

    def there_and_back(splat: Callable[[], Tensor]) -> Call:
        return lambda: torch.autograd.grad(splat(), (context, depth_prob), slope)

    def plain_map() -> Tensor:
        return lift_splat_cumsum(context, depth_prob, points(), model.grid)

    def fast_map() -> Tensor:
        return pool(context, depth_prob, index(), model.grid)

    with torch.no_grad():
        expected = plain_map()
        error = float((fast_map() - expected).abs().max() / expected.abs().max())
    name = f"lift and splat, forward and backward, batch {work.batch_size}"
    yield Row(
        f"{name}, new calibration",
        "cumulative sum, analytic gradient, float32",
        "embedding bag, index built anew",
        in_turn(work, there_and_back(plain_map), there_and_back(fast_map)),
        8.0,
        checks=(Check(f"largest difference {error:.0e} of the largest value", error < 1e-3),),
    )
    pair = in_turn(work, there_and_back(plain_map), index)
    median_ms = 1e3 * pair.fast_s.median
    yield Row(
        f"index of {work.batch_size} new calibrations",
        f"{name}, cumulative sum",
        "the splat's index alone",
        pair,
        1.0,
        checks=(Check(f"{median_ms:.2f} ms (less than 2)", median_ms < 2.0),),
    )


def in_turn(work: Work, plain: Call, fast: Call) -> Pair:
    """Time two sides in turn, then the most memory that a call of each takes."""
    for side in (plain, fast):
        for _ in range(3):
            side()
    plain_s, fast_s = [], []
    for _ in range(work.repeats):
        plain_s.append(_seconds(work, plain, work.calls))
        fast_s.append(_seconds(work, fast, work.calls))
    return _pair(plain_s, fast_s, _peak_mb(work, plain), _peak_mb(work, fast))


def _pair(plain_s: list[float], fast_s: list[float], plain_mb: float, fast_mb: float) -> Pair:
    ratio = Spread.of([p / f for p, f in zip(plain_s, fast_s, strict=True)])
    return Pair(Spread.of(plain_s), Spread.of(fast_s), ratio, plain_mb, fast_mb)


def _wait(work: Work) -> None:
    if work.device != "cpu":
        torch.cuda.synchronize()


def _seconds(work: Work, call: Call, calls: int) -> float:
    """Mean time of some calls, until the device has done them all."""
    _wait(work)
    started = time.perf_counter()
    for _ in range(calls):
        call()
    _wait(work)
    return (time.perf_counter() - started) / calls


def _peak_mb(work: Work, call: Call) -> float:
    """Most memory of the card that a call takes beyond what stood before it; see `_Memory`."""
    memory = _Memory(work)
    call()
    _wait(work)
    return memory.peak_mb()


class _Memory:
    """Of the card, from now on, in 10^6 bytes; 0 on the CPU."""

    def __init__(self, work: Work) -> None:
        self._on_card = work.device != "cpu"
        if self._on_card:
            torch.cuda.reset_peak_memory_stats()
            self._before = torch.cuda.memory_allocated()

    def peak_mb(self) -> float:
        if not self._on_card:
            return 0.0
        return (torch.cuda.max_memory_allocated() - self._before) / 1e6


def _moved(sensors: Batch, n: int) -> Tensor:
    """The cameras, n centimetres further ahead."""
    poses = sensors.ego_from_camera.clone()
    poses[..., 0, 3] += 0.01 * n
    return poses


class _Clock(pl.Callback):
    """Seconds a step, after those that warm up; and the most memory on the card."""

    def __init__(self, work: Work, warm_up: int) -> None:
        self._work = work
        self._warm_up = warm_up
        self.step_s = 0.0
        self.peak_mb = 0.0

    def on_train_batch_end(self, trainer: pl.Trainer, *_: Any) -> None:
        if trainer.global_step not in (self._warm_up, trainer.max_steps):
            return
        _wait(self._work)
        if trainer.global_step == self._warm_up:
            self._memory = _Memory(self._work)
            self._started = time.perf_counter()
        else:
            steps = trainer.global_step - self._warm_up
            self.step_s = (time.perf_counter() - self._started) / steps
            self.peak_mb = self._memory.peak_mb()


def _shoot_train(work: Work) -> tuple[float, float]:
    """Seconds a step and memory of the loop that `shoot-train` runs, on batches made before."""
    warm_up = 5
    steps = warm_up + work.steps
    on_card = work.device != "cpu"
    batch = PlanBatch(
        work.sensors(work.batch_size),
        torch.zeros(work.batch_size, 1, 2),
        torch.arange(work.batch_size),
    )
    clock = _Clock(work, warm_up)
    with tempfile.TemporaryDirectory() as folder:
        config = replace(
            work.config,
            out=folder,
            precision="32-true",
            accelerator="gpu" if on_card else "cpu",
            devices=1,
            optim=replace(work.config.optim, steps=steps, batch_size=work.batch_size),
            val_every=steps,
        )
        run = PlanningRun(Path(folder))
        module = work.module()
        run.begin(config, module.task)
        trainer = make_trainer(config, run, module.task)
        trainer.callbacks.append(clock)
        loader: Any = DataLoader([batch] * steps, batch_size=None, pin_memory=on_card)
        last: Any = DataLoader([batch], batch_size=None)
        trainer.fit(module, loader, last)
    return clock.step_s, clock.peak_mb
