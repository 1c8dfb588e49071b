"""The ego's own past as the only input: a small network without cameras."""

import logging
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from typing import Any

import numpy as np
import numpy.typing as npt
import torch
from jaxtyping import Float, Int
from torch import Tensor, nn

from shoot.baselines.folds import scene_folds
from shoot.baselines.prior import fit_prior
from shoot.trajectories import DT_S, Futures

Array = npt.NDArray[Any]

logger = logging.getLogger(__name__)

HIDDEN = 128
BATCH_SIZE = 256
MAX_EPOCHS = 60
# Epochs without a better NLL on the scenes held out, after which none is expected.
PATIENCE = 6
LEARNING_RATE = 2e-3
WEIGHT_DECAY = 1e-2
# Below it, differences of speed matter in relation, above it, in themselves.
_CREEPING_MPS = 0.2


class PastMotionNet(nn.Module):
    """Two hidden layers from past motion to the logits of all templates.

    Before training it says the prior, whatever the input.

    Args:
        inputs: Motion of the training samples; means and spreads are taken from them.
        log_prior: Of the templates, in nats.
        generator: Of the first weights.
    """

    mean: Tensor
    spread: Tensor

    def __init__(
        self,
        inputs: Float[Tensor, "S F"],
        log_prior: Float[Tensor, " K"],
        generator: torch.Generator,
    ) -> None:
        super().__init__()
        self.register_buffer("mean", inputs.mean(0))
        # What never differs in training must not become huge if it differs later.
        self.register_buffer("spread", inputs.std(0, correction=0).clamp(min=1e-2))
        first, second = nn.Linear(inputs.shape[1], HIDDEN), nn.Linear(HIDDEN, HIDDEN)
        self.hidden = nn.Sequential(first, nn.ReLU(), second, nn.ReLU())
        self.last = nn.Linear(HIDDEN, len(log_prior))
        for layer in (first, second):
            nn.init.kaiming_uniform_(layer.weight, nonlinearity="relu", generator=generator)
            nn.init.zeros_(layer.bias)
        nn.init.zeros_(self.last.weight)
        with torch.no_grad():
            self.last.bias.copy_(log_prior)

    def forward(self, inputs: Float[Tensor, "B F"]) -> Float[Tensor, "B K"]:
        """Logits of the templates."""
        logits: Tensor = self.last(self.hidden((inputs - self.mean) / self.spread))
        return logits

    @torch.no_grad()
    def log_prob(self, inputs: Float[Tensor, "S F"]) -> Float[Tensor, "S K"]:
        """Log-probabilities of the templates, in nats."""
        return self(inputs).log_softmax(dim=-1)


@dataclass(frozen=True)
class PastMotionFit:
    """What the ego's past says of its future.

    Attributes:
        net: Trained on all training samples.
        epochs: Passes over them, chosen on scenes held out.
        held_out_nll: NLL on those scenes after as many passes over the others, in nats; NaN if
            there was one scene only.
    """

    net: PastMotionNet
    epochs: int
    held_out_nll: float

    def log_prob(self, futures: Futures) -> Float[Array, "S K"]:
        """Log-probabilities of the templates in nats, from the past of each sample alone."""
        log_prob: Array = self.net.log_prob(motion_inputs(futures)).numpy()
        return log_prob


def motion_inputs(futures: Futures) -> Float[Tensor, "S F"]:
    """What the network sees of each sample.

    Speed, speed on a scale that tells standing from creeping, yaw rate; for each past step whether
    it is known, and the velocity over it less the velocity now. Where a step is not known, the
    latter is 0, as if the ego had driven as it does now; where no motion is known, all are 0.

    Args:
        futures: Of which only the past is read.
    """
    num = len(futures.past_known)
    velocity_mps = futures.velocity_mps
    speed_mps = np.linalg.norm(velocity_mps, axis=1)
    until_m = np.concatenate([np.zeros((num, 1, 2)), futures.past_xy_m[:, :-1]], axis=1)
    stepwise_mps = (until_m - futures.past_xy_m) / DT_S
    change_mps = np.where(futures.past_known[..., None], stepwise_mps - velocity_mps[:, None], 0.0)
    now = np.stack(
        [speed_mps, np.arcsinh(speed_mps / _CREEPING_MPS), futures.yaw_rate_radps], axis=1
    )
    inputs = np.concatenate([now, futures.past_known, change_mps.reshape(num, -1)], axis=1)
    return torch.from_numpy(inputs).float()


def fit_past_motion(
    futures: Futures, labels: Int[Array, " S"], num_templates: int, seed: int = 0
) -> PastMotionFit:
    """A network that never looks, but knows how the ego got here; trained with cross-entropy.

    The number of epochs is the one with the smallest NLL on a fifth of the training scenes, held
    out; the network is then trained again on all of them for as many. With one scene there is
    nothing to choose by, and it stays at the prior.

    Args:
        futures: Of the training samples; only past and scene are read.
        labels: Their nearest templates.
        num_templates: K.
        seed: Of first weights and of the order of samples.

    Raises:
        ValueError: If there are no labels, or one is not among the K templates.
    """
    if not len(labels):
        raise ValueError("Fitting past motion needs at least one training label, got none.")
    inputs, answers = motion_inputs(futures), torch.from_numpy(labels)
    fold = scene_folds(futures.scene)
    epochs, held_out_nll = 0, float("nan")
    if fold.max() > 0:
        held_out = torch.from_numpy(fold == 0)
        asked, right = inputs[held_out], answers[held_out]
        log_prior = fit_prior(labels[fold != 0], futures.scene[fold != 0], num_templates)
        held_out_nll = float("inf")
        for epoch, net in enumerate(
            _training(inputs[~held_out], answers[~held_out], log_prior, seed)
        ):
            nll = float(nn.functional.nll_loss(net.log_prob(asked), right))
            if nll < held_out_nll:
                epochs, held_out_nll = epoch, nll
            if epoch in (MAX_EPOCHS, epochs + PATIENCE):
                break
    logger.info(
        "Past motion: %d epochs, NLL %.3f on training scenes left out.", epochs, held_out_nll
    )
    log_prior = fit_prior(labels, futures.scene, num_templates)
    net = next(islice(_training(inputs, answers, log_prior, seed), epochs, None))
    return PastMotionFit(net, epochs, held_out_nll)


def _training(
    inputs: Float[Tensor, "S F"],
    labels: Int[Tensor, " S"],
    log_prior: Float[Array, " K"],
    seed: int,
) -> Iterator[PastMotionNet]:
    """The network after 0, 1, 2 ... epochs; always the same object, so use it before the next."""
    generator = torch.Generator().manual_seed(seed)
    net = PastMotionNet(inputs, torch.from_numpy(log_prior).float(), generator)
    optimizer = torch.optim.AdamW(net.parameters(), lr=LEARNING_RATE, weight_decay=WEIGHT_DECAY)
    while True:
        yield net
        for rows in torch.randperm(len(labels), generator=generator).split(BATCH_SIZE):
            loss = nn.functional.cross_entropy(net(inputs[rows]), labels[rows])
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()
