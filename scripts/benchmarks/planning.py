"""The whole planner at paper size: one sample planned, and one step trained."""

import os
import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import torch
from torch import Tensor
from torch.utils.flop_counter import FlopCounterMode

from benchmarks import paper_size
from lss_core.batch import Batch
from lss_core.camera import frustum_points
from lss_core.splat_reference import lift_splat_cumsum
from shoot.export import PlannerGraph, make_card, write_onnx
from shoot.export.int8 import open_session
from shoot.export.samples import inputs_of
from shoot.prediction.fast import FastPlanner
from shoot.prediction.run import TrainedRun
from shoot.templates import TemplateSet
from shoot.training.allocation import keep_freed_memory
from shoot.training.planning.config import PAPER, TrainConfig
from shoot.training.planning.run_folder import PlanningRun
from shoot.training.planning.task import PlanningModule
from shoot.training.precision import fastest_precision

BATCH_SIZE = 4
CONFIG: TrainConfig = replace(PAPER, model=paper_size.MODEL)
TEMPLATES = Path(__file__).parents[2] / "templates" / "synthetic-1000" / "templates.npz"


def new_module() -> PlanningModule:
    """The paper's planner before training, always the same."""
    torch.manual_seed(0)
    return PlanningModule(CONFIG, TemplateSet.load(TEMPLATES))


def plain_scores(module: PlanningModule, sensors: Batch) -> Tensor:
    """[B, K] scores the straightforward way: contiguous tensors, the paper's cumulative sum."""
    model = module.model
    config = model.config
    batch = sensors.images.shape[:2]
    context, depth_prob = model.image_encoder(sensors.images.flatten(0, 1).float() / 255.0)
    points_ego = frustum_points(
        model.image_hw,
        config.image_stride,
        config.depth.depths_m,
        sensors.pixel_from_camera,
        sensors.ego_from_camera,
    )
    bev = lift_splat_cumsum(
        context.unflatten(0, batch), depth_prob.unflatten(0, batch), points_ego, config.grid
    )
    scores: Tensor = module.planner(model.bev_encoder(bev.contiguous())[:, 0])
    return scores


def plain_plan() -> Callable[[], Tensor]:
    """Images of one sample to probabilities, float32."""
    module, sensors = new_module().eval(), paper_size.batch(1)
    return torch.no_grad()(lambda: plain_scores(module, sensors).softmax(dim=-1))


def fast_plan() -> Callable[[], Tensor]:
    """Images of one sample to probabilities, by `FastPlanner`."""
    keep_freed_memory()
    planner, sensors = FastPlanner(new_module()), paper_size.batch(1)
    return lambda: planner(sensors).softmax(dim=-1)


def uncompiled_plan() -> Callable[[], Tensor]:
    """The same where there is no compiler."""
    keep_freed_memory()
    planner, sensors = FastPlanner(new_module(), compiled=False), paper_size.batch(1)
    return lambda: planner(sensors).softmax(dim=-1)


def onnx_plan() -> Callable[[], Any]:
    """The same by onnxruntime on the exported file, its splat index made once; float32."""
    return _in_onnxruntime(new_module(), paper_size.batch(1))


def onnx_change() -> tuple[float, float]:
    """The largest change of a probability from PyTorch's float32 to onnxruntime; the largest one.

    Of a planner whose costs differ as a trained one's do.
    """
    module, sensors = new_module().eval(), paper_size.batch(1)
    with torch.no_grad():
        module.model.bev_encoder.head.weight *= 1e4
        expected = module(sensors).softmax(dim=-1).numpy()
    found = _in_onnxruntime(module, sensors)()
    return float(abs(found - expected).max()), float(expected.max())


def _in_onnxruntime(module: PlanningModule, sensors: Batch) -> Callable[[], Any]:
    run = TrainedRun(CONFIG, TemplateSet.load(TEMPLATES), module, PlanningRun(TEMPLATES.parent))
    graph = PlannerGraph(module)
    inputs = inputs_of(make_card(run, graph), sensors, 0)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "planner.onnx"
        write_onnx(graph, file)
        session = open_session(file)
    return lambda: session.run(["probabilities"], inputs)[0]


def first_plan(compiler_cache: Path) -> None:
    """The first call of a `FastPlanner`, which compiles, with torch's cache in a folder."""
    os.environ["TORCHINDUCTOR_CACHE_DIR"] = str(compiler_cache)
    fast_plan()()


def trained_step(
    module: PlanningModule, scores: Callable[[Batch], Tensor], sensors: Batch
) -> Callable[[], Tensor]:
    """A step of Adam on a batch, as training does it."""
    module.train()
    labels = torch.arange(len(sensors.sample_idx), device=module.device)
    optimizer: Any = torch.optim.Adam(module.parameters(), lr=1e-3, weight_decay=1e-7)

    def step() -> Tensor:
        loss = module.planner.loss(scores(sensors), labels)
        optimizer.zero_grad()
        torch.autograd.backward(loss)
        torch.nn.utils.clip_grad_norm_(module.parameters(), CONFIG.optim.clip_norm)
        optimizer.step()
        return loss.detach()

    return step


def plain_step() -> Callable[[], Tensor]:
    """A training step the straightforward way, float32."""
    module = new_module()
    sensors = paper_size.batch(BATCH_SIZE)
    return trained_step(module, lambda sensors: plain_scores(module, sensors), sensors)


def fast_step() -> Callable[[], Tensor]:
    """A training step as `shoot-train` does it here; no calibration has been seen before."""
    keep_freed_memory()
    module = new_module()
    mixed = fastest_precision(torch.device("cpu")) == "bf16-mixed"

    def scores(sensors: Batch) -> Tensor:
        module.model.cache.clear()
        with torch.autocast("cpu", torch.bfloat16, enabled=mixed):
            result: Tensor = module(sensors)
        return result

    return trained_step(module, scores, paper_size.batch(BATCH_SIZE))


def plan_flop() -> int:
    """Floating-point operations of convolutions and products, whole map, one sample."""
    module, sensors = new_module().eval(), paper_size.batch(1)
    with FlopCounterMode(display=False) as counter, torch.no_grad():
        module(sensors)
    return int(counter.get_total_flops())


def step_flop() -> int:
    """Floating-point operations of a training step, forward and backward."""
    module, sensors = new_module(), paper_size.batch(BATCH_SIZE)
    with FlopCounterMode(display=False) as counter:
        torch.autograd.backward(module.planner.loss(module(sensors), torch.arange(BATCH_SIZE)))
    return int(counter.get_total_flops())
