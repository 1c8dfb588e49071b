"""A trained planner made fast for prediction: the same probabilities to rounding, for less."""

import logging
import time
from collections.abc import Callable
from typing import Any

import torch
import torch._inductor.config
from jaxtyping import Float
from torch import Tensor

from lss_core.batch import Batch
from lss_core.model import CameraModel, LidarModel
from lss_core.splat import pool
from shoot.precision import fastest_precision
from shoot.training import PlanningModule

logger = logging.getLogger(__name__)


class FastPlanner:
    """Images or lidar points to scores of all templates, with the weights of a trained module.

    - Convolutions run in bfloat16 where this machine is clearly faster in it (`fastest_precision`);
      geometry, splat and scores stay float32.
    - The networks are compiled with their weights as constants: batch norm is folded into the
      convolutions, what follows a convolution is fused with it. (That of pillars, which sees
      another number of points each time and is small, is not.)
    - The decoder runs only around the cells that templates read.
    - An unchanged calibration costs nothing (`SplatCache`).

    Samples run one by one, so that one compilation serves batches of all sizes; a rig with another
    number of cameras takes another one. The first call compiles, for up to a minute; torch keeps
    compiled code on disk ($TORCHINDUCTOR_CACHE_DIR), and later processes start sooner. Where
    compiling fails, for want of a C++ compiler say, it runs uncompiled and says so.

    Attributes:
        compiled: Whether the networks run compiled; settled by the first call.

    Args:
        module: Trained; its weights must not change any more.
        compiled: False: do not try.
    """

    def __init__(self, module: PlanningModule, compiled: bool = True) -> None:
        self.compiled = compiled
        self._is_settled = not compiled
        self._module = module.eval()
        self._precision = fastest_precision(module.device)
        self._window = module.planner.reads.window(module.planner.grid)
        self._reads = module.planner.reads.within(self._window, module.planner.grid)
        self._compile_networks()

    def _compile_networks(self) -> None:
        """Make the two networks ready, as they are or compiled at their first call."""
        model = self._module.model

        def ready(network: Callable[..., Any]) -> Callable[..., Any]:
            return torch.compile(network, dynamic=False) if self.compiled else network

        self._encode_map = ready(model.bev_encoder)
        if isinstance(model, CameraModel):
            self._encode_images = ready(model.image_encoder)

    @torch.no_grad()
    def __call__(self, sensors: Batch) -> Float[Tensor, "B K"]:
        """Scores (logits) of the templates.

        Args:
            sensors: A batch on the module's device.
        """
        # Weights become constants. As an option of torch.compile it comes too late for tracing.
        with torch._inductor.config.patch(freezing=True):
            if not self._is_settled:
                self._settle(sensors)
            return torch.cat([self._score(sensors, b) for b in range(len(sensors.sample_idx))])

    def _settle(self, sensors: Batch) -> None:
        """Compile by a first call, or do without."""
        started = time.monotonic()
        try:
            self._score(sensors, 0)
            logger.info("Compiled in %.0f s.", time.monotonic() - started)
        except Exception as error:  # the compiler's stages raise dozens of kinds
            reason = str(error).strip().splitlines() or [type(error).__name__]
            logger.warning("Could not be compiled here, runs uncompiled: %s", reason[0])
            self.compiled = False
            self._compile_networks()
        self._is_settled = True

    def _score(self, sensors: Batch, b: int) -> Float[Tensor, "1 K"]:
        with torch.autocast(
            sensors.images.device.type, torch.bfloat16, enabled=self._precision == "bf16-mixed"
        ):
            cost_map = self._encode_map(self._bev(sensors, b), self._window)[:, 0]
            return self._module.planner.score(cost_map, self._reads)

    def _bev(self, sensors: Batch, b: int) -> Float[Tensor, "1 C X Y"]:
        """What the sensors of one sample say of each cell."""
        model = self._module.model
        if isinstance(model, LidarModel):
            start, count = (int(n[b]) for n in (sensors.point_offsets, sensors.point_counts))
            points = sensors.points[start : start + count]
            pillars: Tensor = model.pillar_encoder(points, sensors.point_counts.new_zeros(1))
            return pillars
        one = slice(b, b + 1)
        # Masked images run along, so that shapes stay; the index has none of their points.
        context, depth_prob = self._encode_images(model.network_images(sensors.images[b]))
        index = model.splat_index(
            sensors.pixel_from_camera[one], sensors.ego_from_camera[one], sensors.camera_mask[one]
        )
        return pool(context[None], depth_prob[None], index, model.config.grid)
