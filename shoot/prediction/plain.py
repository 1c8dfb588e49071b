"""A trained planner for those who only plan: the same weights without what trains them."""

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

import torch
from jaxtyping import Float
from torch import Tensor, nn

from lss_core.batch import Batch
from lss_core.errors import DataError
from lss_core.model import make_model
from shoot.planner import Planner
from shoot.templates.template_set import TemplateSet
from shoot.training.checkpoint_file import read_run_weights
from shoot.training.config import CONFIG_FILE
from shoot.training.device import choose_device
from shoot.training.planning.config import TrainConfig
from shoot.training.planning.mark import check_mark

ModuleT = TypeVar("ModuleT", bound=nn.Module)


class PlainPlanner(nn.Module):
    """Sensors to scores of all templates, under the names that a run's weights have.

    Lightning, metrics and their libraries take seconds to load; nothing here needs them.

    Args:
        config: Of the run.
        templates: What it chooses from.
    """

    def __init__(self, config: TrainConfig, templates: TemplateSet) -> None:
        super().__init__()
        num_maps = config.planner.num_maps(templates.points.shape[1])
        self.model = make_model(config.model, config.data, num_maps)
        self.planner = Planner(torch.tensor(templates.points), config.model.grid, config.planner)

    def cost_maps(self, sensors: Batch) -> Float[Tensor, "B C X Y"]:
        """Cost per cell, of all times or of each waypoint's."""
        maps: Tensor = self.model.forward_batch(sensors)
        return maps

    def scores(self, cost_maps: Float[Tensor, "B C X Y"]) -> Float[Tensor, "B K"]:
        """Scores (logits) of the templates."""
        scores: Tensor = self.planner(cost_maps)
        return scores


@dataclass(frozen=True)
class PlainRun:
    """A run ready to plan.

    Attributes:
        folder: Where it is.
        config: What it was told.
        templates: What it chooses from.
        planner: In evaluation mode.
        digest: SHA-256 of its weights.
    """

    folder: Path
    config: TrainConfig
    templates: TemplateSet
    planner: PlainPlanner
    digest: str


def open_plain(folder: Path) -> PlainRun:
    """Load a planner's config, templates and last weights.

    Args:
        folder: Run folder.

    Raises:
        DataError: If something is missing or does not fit together.
    """
    config = TrainConfig.load(folder / CONFIG_FILE)
    config = replace(config, model=replace(config.model, pretrained="none"))
    templates = TemplateSet.load(folder / "templates.npz")
    stored = read_run_weights(folder, "last")
    check_mark(stored, templates, f"'{folder}'")
    weights: dict[str, Tensor] = stored["state_dict"]
    planner = with_weights(lambda: PlainPlanner(config, templates), weights, folder)
    planner = planner.eval().to(choose_device())
    return PlainRun(folder, config, templates, planner, _digest(weights))


def with_weights(
    make: Callable[[], ModuleT], weights: Mapping[str, Tensor], folder: Path
) -> ModuleT:
    """A module with the weights of a run.

    Args:
        make: The module without them.
        weights: By name.
        folder: Of the run.

    Raises:
        DataError: If they do not fit.
    """
    try:
        module = make()
        module.load_state_dict(weights)
    except (RuntimeError, ValueError, ArithmeticError, MemoryError) as error:
        raise DataError(
            f"The weights in '{folder}' do not fit its config.yaml: {str(error)[:200]}..."
        ) from error
    return module


def _digest(weights: Mapping[str, Tensor]) -> str:
    digest = hashlib.sha256()
    for name in sorted(weights):
        tensor = weights[name].detach().cpu().contiguous()
        digest.update(f"{name} {tensor.dtype} {list(tensor.shape)}".encode())
        digest.update(tensor.numpy().tobytes())
    return digest.hexdigest()
