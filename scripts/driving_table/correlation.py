"""Which open-loop figure tells who drives well: rank correlations over planners, with intervals."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.stats import rankdata

from shoot.metrics.bootstrap import SEED, Interval

Array = np.ndarray[Any, np.dtype[Any]]


# Ranks are sorted anew in each.
_NUM_DRAWS = 1000


def rank_correlation(x: Array, y: Array) -> float:
    """Spearman's, with mean ranks where values are equal; NaN if either has one value only."""
    ranks = rankdata(x), rankdata(y)
    if any(np.ptp(rank) == 0.0 for rank in ranks):
        return float("nan")
    return float(np.corrcoef(*ranks)[0, 1])


def correlate(
    figures: Sequence[float],
    scores: Array,
    towns: Sequence[int],
    groups: Sequence[str],
    num_draws: int = _NUM_DRAWS,
) -> Interval:
    """Rank correlation between figures and mean driving scores, with its 95 % interval.

    Each draw takes planners again, all seeds of one together, and towns again, the same for all.

    Args:
        figures: Of each run, high is good.
        scores: [runs, routes] driving scores.
        towns: Of each route.
        groups: Planner of each run.
        num_draws: Number of draws.
    """
    figure = np.array(figures)
    by_town = _town_means(scores, np.array(towns))
    members = [np.flatnonzero(np.array(groups) == name) for name in dict.fromkeys(groups)]
    generator = np.random.default_rng(SEED)
    draws = []
    for _ in range(num_draws):
        chosen = generator.integers(len(members), size=len(members))
        runs = np.concatenate([members[i] for i in chosen])
        seen = generator.integers(by_town.shape[1], size=by_town.shape[1])
        draws.append(rank_correlation(figure[runs], by_town[np.ix_(runs, seen)].mean(axis=1)))
    value = rank_correlation(figure, by_town.mean(axis=1))
    low, high = np.nanpercentile(draws, [2.5, 97.5])
    return Interval(value, float(low), float(high))


def _town_means(scores: Array, towns: Array) -> Array:
    """[runs, towns]; every town has as many routes."""
    return np.stack([scores[:, towns == town].mean(axis=1) for town in np.unique(towns)], axis=1)
