"""The ego's own past as the only input: a few small networks without cameras."""

import copy
import logging
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from scipy.special import logsumexp
from torch import Tensor, nn

from shoot.baselines.folds import scene_folds
from shoot.baselines.prior import fit_prior
from shoot.trajectories import PAST_DT_S, Futures

Array = np.ndarray[Any, np.dtype[Any]]

logger = logging.getLogger(__name__)

HIDDEN = 128
# Numbers in which motion and template meet.
SHARED = 64
MAX_BATCH_SIZE = 256
# An epoch of few samples has smaller batches instead of few steps.
STEPS_AN_EPOCH = 40
# One alone is a draw: by its seed, its accuracy differs by points.
NUM_NETS = 5
# Never reached as long as the rate decays as it does.
MAX_EPOCHS = 100
# Epochs without a better NLL on the scenes held out, after which none is expected.
PATIENCE = 6
# Of that NLL; less is not better, but the decay of the rate.
LEAST_GAIN = 1e-3
LEARNING_RATE = 6e-3
# Of the learning rate, from one epoch to the next.
RATE_DECAY = 0.85
WEIGHT_DECAY = 1e-2
# Below it, differences of speed matter in relation, above it, in themselves.
_CREEPING_MPS = 0.2


class PastMotionNet(nn.Module):
    """From past motion to the logits of all templates.

    One small network (two hidden layers) reads the motion, another the points of each template; the
    logit is the product of what they make of it, plus the prior. That the second knows where
    templates lie lets a sample speak for the neighbours of its label too: with free weights for
    each of 1000 templates, a few thousand samples would teach little. Before training it says the
    prior, whatever the input.

    Args:
        inputs: Motion of the training samples; means and spreads are taken from them.
        templates: Templates in metres in `ego`.
        log_prior: Of the templates, in nats.
        generator: Of the first weights.
    """

    mean: Tensor
    spread: Tensor
    points: Tensor
    log_prior: Tensor

    def __init__(
        self,
        inputs: Float[Tensor, "S F"],
        templates: Float[Tensor, "K T 2"],
        log_prior: Float[Tensor, " K"],
        generator: torch.Generator,
    ) -> None:
        super().__init__()
        self.register_buffer("mean", inputs.mean(0))
        # What never differs in training must not become huge if it differs later.
        self.register_buffer("spread", inputs.std(0, correction=0).clamp(min=1e-2))
        scale_m = templates.std((0, 1), correction=0).clamp(min=1e-2)
        self.register_buffer("points", ((templates - templates.mean(0)) / scale_m).flatten(1))
        self.register_buffer("log_prior", log_prior)
        last = _linear(HIDDEN, SHARED, generator)
        nn.init.zeros_(last.weight)
        nn.init.zeros_(last.bias)
        self.read_motion = nn.Sequential(
            _linear(inputs.shape[1], HIDDEN, generator),
            nn.ReLU(),
            _linear(HIDDEN, HIDDEN, generator),
            nn.ReLU(),
            last,
        )
        self.read_template = nn.Sequential(
            _linear(self.points.shape[1], HIDDEN, generator),
            nn.ReLU(),
            _linear(HIDDEN, SHARED, generator),
        )

    def forward(self, inputs: Float[Tensor, "B F"]) -> Float[Tensor, "B K"]:
        """Logits of the templates for inputs as `motion_inputs` makes them."""
        motion = self.read_motion((inputs - self.mean) / self.spread)
        logits: Tensor = motion @ self.read_template(self.points).T + self.log_prior
        return logits

    @torch.no_grad()
    def log_prob(self, inputs: Float[Tensor, "S F"]) -> Float[Tensor, "S K"]:
        """Log-probabilities of the templates, in nats."""
        log_prob: Tensor = self(inputs).log_softmax(dim=-1)
        return log_prob


@dataclass(frozen=True)
class PastMotionFit:
    """What the ego's past says of its future.

    Attributes:
        nets: Differ in their seed, and in the fold of training scenes that they have not seen.
        epochs: Passes over the others, chosen on the scenes held out.
        held_out_nll: Mean NLL of each network on its own held-out scenes after as many, in nats;
            NaN if there was one scene only.
    """

    nets: tuple[PastMotionNet, ...]
    epochs: int
    held_out_nll: float

    def log_prob(self, futures: Futures) -> Float[Array, "S K"]:
        """Log-probabilities of the templates in nats, from the past of each sample alone.

        Probabilities are the means of those of the networks.
        """
        inputs = motion_inputs(futures)
        # Added up one by one: all at once, S x K numbers would stand in memory five times.
        total = self.nets[0].log_prob(inputs).numpy()
        for net in self.nets[1:]:
            total = np.logaddexp(total, net.log_prob(inputs).numpy())
        log_prob: Array = total - logsumexp(total, axis=1, keepdims=True)
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
    stepwise_mps = (until_m - futures.past_xy_m) / PAST_DT_S
    change_mps = np.where(futures.past_known[..., None], stepwise_mps - velocity_mps[:, None], 0.0)
    now = np.stack(
        [speed_mps, np.arcsinh(speed_mps / _CREEPING_MPS), futures.yaw_rate_radps], axis=1
    )
    inputs = np.concatenate([now, futures.past_known, change_mps.reshape(num, -1)], axis=1)
    return torch.from_numpy(inputs).float()


def fit_past_motion(
    futures: Futures, labels: Int[Array, " S"], templates: Float[Array, "K T 2"], seed: int = 0
) -> PastMotionFit:
    """Networks that never look, but know how the ego got here; trained with cross-entropy.

    Each leaves out another fold of the training scenes. All are trained for the number of epochs
    that has the smallest NLL on what they leave out, summed over them. With one scene there is
    nothing to choose by, and they stay at the prior.

    Args:
        futures: Of the training samples; only past and scene are read.
        labels: Their nearest templates.
        templates: Templates in metres in `ego`.
        seed: Of first weights and of the order of samples.

    Raises:
        ValueError: If there are no labels, or one is not among the K templates.
    """
    if not len(labels):
        raise ValueError("Fitting past motion needs at least one training label, got none.")
    inputs, answers = motion_inputs(futures), torch.from_numpy(labels)
    fold = scene_folds(futures.scene, NUM_NETS)
    num_folds = int(fold.max()) + 1
    # With one scene, none is left out.
    held_out = [fold == (i % num_folds if num_folds > 1 else -1) for i in range(NUM_NETS)]
    trainings = []
    for number, left_out in enumerate(held_out):
        log_prior = fit_prior(labels[~left_out], futures.scene[~left_out], len(templates))
        seen = torch.from_numpy(~left_out)
        trainings.append(
            _training(
                inputs[seen],
                answers[seen],
                torch.from_numpy(templates).float(),
                log_prior,
                NUM_NETS * seed + number,
            )
        )
    epochs, held_out_nll = 0, float("nan")
    nets = [next(training) for training in trainings]
    best = copy.deepcopy(nets)
    if num_folds > 1:
        held_out_nll = _held_out_nll(nets, inputs, answers, held_out)
        for epoch in range(1, MAX_EPOCHS + 1):
            nets = [next(training) for training in trainings]
            nll = _held_out_nll(nets, inputs, answers, held_out)
            if nll < held_out_nll - LEAST_GAIN:
                epochs, held_out_nll, best = epoch, nll, copy.deepcopy(nets)
            if epoch == epochs + PATIENCE:
                break
    logger.info(
        "Past motion: %d epochs, NLL %.3f on training scenes left out.", epochs, held_out_nll
    )
    return PastMotionFit(tuple(best), epochs, held_out_nll)


def _held_out_nll(
    nets: list[PastMotionNet],
    inputs: Float[Tensor, "S F"],
    labels: Int[Tensor, " S"],
    held_out: list[Bool[Array, " S"]],
) -> float:
    """Mean over all samples held out, each asked of the networks that have not seen it."""
    nll_sum = 0.0
    for net, left_out in zip(nets, held_out, strict=True):
        rows = torch.from_numpy(left_out)
        log_prob = net.log_prob(inputs[rows])
        nll_sum += float(nn.functional.nll_loss(log_prob, labels[rows], reduction="sum"))
    return nll_sum / sum(int(left_out.sum()) for left_out in held_out)


def _training(
    inputs: Float[Tensor, "S F"],
    labels: Int[Tensor, " S"],
    templates: Float[Tensor, "K T 2"],
    log_prior: Float[Array, " K"],
    seed: int,
) -> Iterator[PastMotionNet]:
    """The network after 0, 1, 2 ... epochs; always the same object, so use it before the next."""
    generator = torch.Generator().manual_seed(seed)
    net = PastMotionNet(inputs, templates, torch.from_numpy(log_prior).float(), generator)
    optimizer = torch.optim.AdamW(net.parameters(), lr=LEARNING_RATE, weight_decay=WEIGHT_DECAY)
    schedule = torch.optim.lr_scheduler.ExponentialLR(optimizer, RATE_DECAY)
    batch_size = min(MAX_BATCH_SIZE, -(-len(labels) // STEPS_AN_EPOCH))
    while True:
        yield net
        order = torch.randperm(len(labels), generator=generator)
        for first in range(0, len(order), batch_size):
            rows = order[first : first + batch_size]
            loss = nn.functional.cross_entropy(net(inputs[rows]), labels[rows])
            optimizer.zero_grad()
            torch.autograd.backward(loss)
            optimizer.step()
        schedule.step()


def _linear(num_in: int, num_out: int, generator: torch.Generator) -> nn.Linear:
    """A layer with torch's own spread of weights, drawn from our generator instead of torch's."""
    layer = nn.Linear(num_in, num_out, device="meta").to_empty(device="cpu")
    bound = num_in**-0.5
    nn.init.uniform_(layer.weight, -bound, bound, generator=generator)
    nn.init.uniform_(layer.bias, -bound, bound, generator=generator)
    return layer
