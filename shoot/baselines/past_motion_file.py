"""Networks of past motion on disk: to fit them takes a minute, which is worth doing once a run."""

import hashlib
import logging
from pathlib import Path
from typing import Any

import numpy as np
import safetensors
import safetensors.torch
import torch
from jaxtyping import Float, Int

from lss_core.files import write_atomically
from shoot.baselines.past_motion import NUM_NETS, PastMotionFit, PastMotionNet, fit_past_motion
from shoot.trajectories import Futures

Array = np.ndarray[Any, np.dtype[Any]]

logger = logging.getLogger(__name__)

# Raise it whenever the same data would give other networks.
_FORMAT = 1


def kept_past_motion(
    path: Path, past: Futures, labels: Int[Array, " S"], templates: Float[Array, "K T 2"]
) -> PastMotionFit:
    """`fit_past_motion`, from a file if it holds what was fitted to the same; else it does then.

    Args:
        path: The file; where it cannot be written, nothing is kept.
        past: Of the training samples.
        labels: Their nearest templates.
        templates: Templates in metres in `ego`.

    Raises:
        ValueError: As `fit_past_motion`.
    """
    fitted_to = _fingerprint(past, labels, templates)
    kept = _load(path, fitted_to, templates)
    if kept is not None:
        return kept
    fit = fit_past_motion(past, labels, templates)
    tensors = {
        f"{number}.{name}": value.contiguous()
        for number, net in enumerate(fit.nets)
        for name, value in net.state_dict().items()
    }
    notes = {
        "fitted_to": fitted_to,
        "epochs": str(fit.epochs),
        "held_out_nll": repr(fit.held_out_nll),
    }
    try:
        with write_atomically(path) as stream:
            stream.write(safetensors.torch.save(tensors, notes))
    except OSError as error:
        logger.info("The networks of past motion are not kept: %s.", error)
    return fit


def _load(path: Path, fitted_to: str, templates: Float[Array, "K T 2"]) -> PastMotionFit | None:
    """What the file holds; None if that is something else."""
    if not path.is_file():
        return None
    try:
        with safetensors.safe_open(path, framework="pt") as stored:
            notes = stored.metadata() or {}
            tensors = {name: stored.get_tensor(name) for name in stored.keys()}  # noqa: SIM118
        if notes["fitted_to"] != fitted_to:
            return None
        if not all(value.isfinite().all() for value in tensors.values()):
            raise ValueError("numbers that are not finite")
        nets = tuple(_net(tensors, f"{number}.", templates) for number in range(NUM_NETS))
        return PastMotionFit(nets, int(notes["epochs"]), float(notes["held_out_nll"]))
    except (OSError, ValueError, LookupError, RuntimeError, safetensors.SafetensorError) as error:
        logger.warning("'%s' is unreadable (%s); its networks are fitted anew.", path, error)
        return None


def _net(
    tensors: dict[str, torch.Tensor], prefix: str, templates: Float[Array, "K T 2"]
) -> PastMotionNet:
    own = {n.removeprefix(prefix): value for n, value in tensors.items() if n.startswith(prefix)}
    net = PastMotionNet(
        own["mean"][None],
        torch.from_numpy(templates).float(),
        own["log_prior"],
        torch.Generator(),
    )
    net.load_state_dict(own)
    return net


def _fingerprint(past: Futures, labels: Int[Array, " S"], templates: Float[Array, "K T 2"]) -> str:
    digest = hashlib.sha256(str(_FORMAT).encode())
    for array in (
        labels,
        past.scene,
        past.velocity_mps,
        past.yaw_rate_radps,
        past.past_xy_m,
        past.past_known,
        templates,
    ):
        digest.update(f"{array.dtype} {array.shape}".encode())
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()
