"""How far from the driven path: over all templates as expected, and of the chosen one by the clock.

The distances of the best few templates (minADE and the like) are in `shoot.metrics.ranks`.
"""

from typing import Any

import numpy as np
from jaxtyping import Float

from shoot.trajectories import DT_S, whole_steps

Array = np.ndarray[Any, np.dtype[Any]]

L2_HORIZONS_S = (1, 2, 3)
# Open-loop L2 is taken at 2 Hz wherever it is reported, whatever the planner's own step.
L2_STEP_S = 0.5

# Samples at once: keeps what is needed beside the [S, K] result for K = 1000 below 20 MB.
_ROWS = 1024


def template_ade(
    futures: Float[Array, "S T 2"], templates: Float[Array, "K T 2"]
) -> Float[Array, "S K"]:
    """Mean distance over the T points from each driven path to each template, in metres.

    Point by point and some samples at a time, so that no array is larger than the result: 24 MB for
    6000 samples and 1000 templates.

    Args:
        futures: Driven paths in metres in `ego`.
        templates: Templates at the same times, in metres in `ego`.

    Returns:
        float32: within 50 m good to a few micrometres.

    Raises:
        ValueError: If paths and templates have other numbers of points.
    """
    if futures.shape[1:] != templates.shape[1:]:
        raise ValueError(
            f"Futures {list(futures.shape)} and templates {list(templates.shape)} must have the "
            "same points."
        )
    ahead, bank = futures.astype(np.float32), templates.astype(np.float32)
    ade_m = np.zeros((len(ahead), len(bank)), dtype=np.float32)
    for start in range(0, len(ahead), _ROWS):
        rows = slice(start, start + _ROWS)
        for point, template_point in zip(
            np.moveaxis(ahead[rows], 1, 0), np.moveaxis(bank, 1, 0), strict=True
        ):
            dx_m, dy_m = (point[:, None, axis] - template_point[:, axis] for axis in range(2))
            ade_m[rows] += np.sqrt(dx_m * dx_m + dy_m * dy_m)
    ade_m /= ahead.shape[1]
    return ade_m


def expected_ade(prob: Float[Array, "R K"], ade_m: Float[Array, "S K"]) -> Float[Array, " S"]:
    """Mean over the whole distribution of the distance from the driven path, in metres.

    What a template drawn at random by its probability would be off on average. Unlike NLL it does
    not punish probability on a near-duplicate of the label.

    Args:
        prob: Probabilities of the templates; R is S, or 1 where they are the same for all samples.
        ade_m: Distances as `template_ade` gives them, made once for all methods.
    """
    every = np.broadcast_to(prob, ade_m.shape)
    expected_m = np.empty(len(ade_m))
    for start in range(0, len(ade_m), _ROWS):
        rows = slice(start, start + _ROWS)
        expected_m[rows] = (every[rows] * ade_m[rows]).sum(axis=1, dtype=np.float64)
    return expected_m


def open_loop_l2(
    chosen: Float[Array, "S T 2"], futures: Float[Array, "S T 2"], dt_s: float = DT_S
) -> dict[str, Float[Array, " S"]]:
    """Distance of the chosen trajectory from the driven path, in both conventions of the field.

    Two numbers go by the name "L2 at 3 s", and the second is the smaller by far: `l2_at_3s` is the
    distance at 3 s (as UniAD reports it), `l2_upto_3s` the mean of the distances at 0.5 s, 1 s, ...
    3 s (ST-P3, VAD). Both look at 2 Hz only.

    Args:
        chosen: One trajectory for each sample, in metres in `ego`.
        futures: Driven paths at the same times, in metres in `ego`.
        dt_s: Time of the first point, and between points.

    Returns:
        `l2_at_1s`, `l2_upto_1s`, ... in metres: of the times at which the paths have points.

    Raises:
        ValueError: If `dt_s` is not more than 0, or there is not one trajectory for each path.
    """
    if chosen.shape != futures.shape:
        raise ValueError(
            f"Chosen trajectories {list(chosen.shape)} and futures {list(futures.shape)} must be "
            "of one shape."
        )
    if not dt_s > 0.0:
        raise ValueError(f"dt_s must be more than 0 s, got {dt_s}.")
    distance_m = np.linalg.norm(chosen - futures, axis=-1)
    stride = whole_steps(L2_STEP_S, dt_s)
    errors: dict[str, Array] = {}
    for horizon_s in L2_HORIZONS_S:
        num_steps = whole_steps(float(horizon_s), dt_s)
        if num_steps is None or num_steps > distance_m.shape[1]:
            continue
        errors[f"l2_at_{horizon_s}s"] = distance_m[:, num_steps - 1]
        if stride is not None:
            upto_m = distance_m[:, stride - 1 : num_steps : stride].mean(axis=1)
            errors[f"l2_upto_{horizon_s}s"] = upto_m
    return errors
