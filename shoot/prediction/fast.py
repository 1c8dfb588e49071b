"""A trained planner made fast for prediction: the same probabilities to rounding, for less."""

import logging
import time
from collections.abc import Callable
from typing import Any

import torch
from jaxtyping import Bool, Float, Shaped
from torch import Tensor

from lss_core.batch import Batch
from lss_core.errors import DataError
from lss_core.model import CameraModel, LidarModel
from lss_core.splat import pool
from shoot.prediction.compiler_cache import frozen_weights
from shoot.prediction.cuda_graph import CannotRecordError, CudaGraphs
from shoot.training.planning.task import PlanningModule
from shoot.training.precision import fastest_precision

logger = logging.getLogger(__name__)


class FastPlanner:
    """Images or lidar points to scores of all templates, with the weights of a trained module.

    - Convolutions run in bfloat16 where this machine is clearly faster in it (`fastest_precision`);
      geometry, splat and scores stay float32.
    - The networks are compiled with their weights as constants: batch norm is folded into the
      convolutions, what follows a convolution is fused with it. (That of pillars, which sees
      another number of points each time and is small, is not.)
    - The decoder runs only around the cells that templates read.
    - On a CPU an unchanged calibration costs nothing (`SplatCache`).
    - On a GPU all from images to scores is one CUDA graph, the splat's index of any calibration
      included; of lidar points, all from the map of pillars on.

    Samples run one by one, so that one compilation serves batches of all sizes; a rig with another
    number of cameras takes another one. The first call compiles, for up to a minute; torch keeps
    compiled code on disk ($TORCHINDUCTOR_CACHE_DIR), and later processes start sooner. Where
    compiling fails, for want of a C++ compiler say, it runs uncompiled and says so.

    Attributes:
        compiled: Whether the networks run compiled; settled by the first call.
        recorded: Whether they run as CUDA graphs; settled by the first call.

    Args:
        module: Trained; its weights must not change any more.
        compiled: False: do not try.

    Raises:
        DataError: If images reach its map in another way than by depths (`lift`).
    """

    def __init__(self, module: PlanningModule, compiled: bool = True) -> None:
        if not isinstance(module.model, CameraModel | LidarModel):
            raise DataError(
                f"Fast prediction is not for planners whose lift is '{module.model.config.lift}'; "
                "predict without it."
            )
        self.compiled = compiled
        self.recorded = module.device.type == "cuda"
        self._is_settled = False
        self._module = module.eval()
        self._precision = fastest_precision(module.device)
        self._window = module.planner.reads.window(module.planner.grid)
        self._reads = module.planner.reads.within(self._window, module.planner.grid)
        self._make_ready()

    def _make_ready(self) -> None:
        """The two networks as they are or compiled, and what they are part of recorded or not."""
        model = self._module.model

        def ready(network: Callable[..., Any]) -> Callable[..., Any]:
            return torch.compile(network, dynamic=False) if self.compiled else network

        def started_at_once(function: Callable[..., Tensor]) -> Callable[..., Tensor]:
            return CudaGraphs(function) if self.recorded else function

        self._encode_map = ready(model.bev_encoder)
        if isinstance(model, CameraModel):
            self._encode_images = ready(model.image_encoder)
            self._score_images = started_at_once(self._scores_of_images)
        else:
            self._score_pillars = started_at_once(self._scores_of_bev)

    @torch.no_grad()
    def __call__(self, sensors: Batch) -> Float[Tensor, "B K"]:
        """Scores (logits) of the templates.

        Args:
            sensors: A batch on the module's device.
        """
        # As an option of torch.compile, frozen weights come too late for tracing.
        with frozen_weights():
            if not self._is_settled:
                self._settle(sensors)
            return torch.cat([self._score(sensors, b) for b in range(len(sensors.sample_idx))])

    def _settle(self, sensors: Batch) -> None:
        """Compile and record by a first call, or do without."""
        started = time.monotonic()
        while self.compiled or self.recorded:
            try:
                self._score(sensors, 0)
                break
            except CannotRecordError as error:
                self.recorded = False
                logger.warning("No CUDA graph can be made here, runs without: %s", _reason(error))
            except Exception as error:  # the compiler's stages raise dozens of kinds
                if not self.compiled:
                    raise
                self.compiled = False
                logger.warning("Could not be compiled here, runs uncompiled: %s", _reason(error))
            self._make_ready()
        if self.compiled:
            logger.info("Compiled in %.0f s.", time.monotonic() - started)
        self._is_settled = True

    def _score(self, sensors: Batch, b: int) -> Float[Tensor, "1 K"]:
        model = self._module.model
        one = slice(b, b + 1)
        if isinstance(model, CameraModel):
            return self._score_images(
                sensors.images[b],
                sensors.pixel_from_camera[one],
                sensors.ego_from_camera[one],
                sensors.camera_mask[one],
            )
        assert isinstance(model, LidarModel)
        start, count = (int(n[b]) for n in (sensors.point_offsets, sensors.point_counts))
        points = sensors.points[start : start + count]
        return self._score_pillars(model.pillar_encoder(points, sensors.point_counts.new_zeros(1)))

    def _scores_of_images(
        self,
        images: Shaped[Tensor, "N 3 Hi Wi"],
        pixel_from_camera: Float[Tensor, "1 N 3 3"],
        ego_from_camera: Float[Tensor, "1 N 4 4"],
        camera_mask: Bool[Tensor, "1 N"],
    ) -> Float[Tensor, "1 K"]:
        model = self._module.model
        assert isinstance(model, CameraModel)
        with self._autocast():
            # Masked images run along, so that shapes stay; the index has none of their points.
            context, depth_prob = self._encode_images(model.network_images(images))
            index = model.splat_index(pixel_from_camera, ego_from_camera, camera_mask)
            bev = pool(context[None], depth_prob[None], index, model.config.grid)
        return self._scores_of_bev(bev)

    def _scores_of_bev(self, bev: Float[Tensor, "1 C X Y"]) -> Float[Tensor, "1 K"]:
        """Of what the sensors of one sample say of each cell."""
        with self._autocast():
            return self._module.planner.score(self._encode_map(bev, self._window), self._reads)

    def _autocast(self) -> torch.autocast:
        # Weights cast once for all would not outlive the recording of a graph that reads them.
        return torch.autocast(
            self._module.device.type,
            torch.bfloat16,
            enabled=self._precision == "bf16-mixed",
            cache_enabled=False,
        )


def _reason(error: Exception) -> str:
    return (str(error).strip().splitlines() or [type(error).__name__])[0]
