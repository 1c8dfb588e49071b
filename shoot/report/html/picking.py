"""Which samples are shown: best, typical and worst."""

from collections.abc import Iterable
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int, Shaped

Array = np.ndarray[Any, np.dtype[Any]]


def pick_samples(
    nll: Float[Array, " S"],
    rank: Int[Array, " S"],
    scene: Shaped[Array, " S"],
    num: int = 3,
    moving: Bool[Array, " S"] | None = None,
) -> dict[str, list[int]]:
    """Positions of the samples a planner does best at, ordinarily and worst, by NLL.

    Typical ones are those around the median. A group takes no second sample of a scene while there
    are samples of other scenes left; no sample stands in two groups. Equal NLLs are decided by
    rank, then by position, so the choice is always the same.

    Args:
        nll: In nats.
        rank: Templates ranked before the label; 0 is best.
        scene: Scene of each sample, any labels.
        num: Samples a group; fewer where there are not three times as many.
        moving: Where given and True anywhere, the best are chosen among these: standing still is
            the easiest thing to foresee, and nine pictures of red lights tell little.

    Returns:
        `best` (best first), `typical` (nearest to the median first) and `worst` (worst first).

    Raises:
        ValueError: If `num` is below 1.
    """
    if num < 1:
        raise ValueError(f"The number of samples a group must be at least 1, got {num}.")
    if len(nll) == 0:
        return {"best": [], "typical": [], "worst": []}
    num = min(num, max(1, len(nll) // 3))
    position = np.arange(len(nll))
    best_first = np.lexsort((position, rank, nll))
    worst_first = np.lexsort((position, -rank, -nll))
    typical_first = np.lexsort((position, rank, np.abs(nll - np.median(nll))))
    if moving is not None and moving.any():
        best_first = best_first[moving[best_first]]
    taken: set[int] = set()
    chosen = {}
    for group, order in (
        ("best", best_first),
        ("worst", worst_first),
        ("typical", typical_first),
    ):
        chosen[group] = _of_many_scenes((int(p) for p in order if p not in taken), scene, num)
        taken.update(chosen[group])
    return {group: chosen[group] for group in ("best", "typical", "worst")}


def _of_many_scenes(order: Iterable[int], scene: Shaped[Array, " S"], num: int) -> list[int]:
    """The first `num` in order of different scenes; if there are too few, the first of the rest."""
    firsts: list[int] = []
    rest: list[int] = []
    names, seen = scene.tolist(), set()
    for position in order:
        (rest if names[position] in seen else firsts).append(position)
        seen.add(names[position])
        if len(firsts) == num:
            break
    return [*firsts, *rest][:num]
