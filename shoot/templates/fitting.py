"""Fits templates to recorded futures: by K-Means, of all or of a stream, or another method."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from importlib.metadata import version

import numpy as np
from numpy.typing import NDArray

from lss_core.bounds import MAX_SEED
from lss_core.errors import DataError
from lss_core.geometry import FloatArray
from shoot.clustering import cluster, cluster_stream
from shoot.templates.methods import Method, TemplateChoice, choose_templates
from shoot.templates.template_set import TemplateSet
from shoot.trajectories import DT_S, HORIZON_S, check_futures


def fit_templates(
    futures: FloatArray,
    k: int,
    seed: int,
    dt_s: float | None = None,
    method: Method = "kmeans",
) -> TemplateSet:
    """K-Means centres of futures, or templates made by another method, most frequent first.

    Paper: section 5.6 (K-Means, K = 1000 on all ego trajectories of the training set).

    Args:
        futures: [M, T, 2] metres in the ego frame of each start.
        k: Number of templates.
        seed: Of the K-Means initialisation; same futures and seed, same templates.
        dt_s: Time between their points; needed unless they are of 5 s, every 0.25 s.
        method: Which; see docs/templates.md.

    Raises:
        DataError: If there are fewer futures than templates, too few distinct ones, or futures that
            no car can have driven.
    """
    _check_seed(seed)
    dt_s = _time_step(futures, dt_s)
    if k < 1 or k > len(futures):
        raise DataError(
            f"Cannot fit {k} templates to {len(futures)} trajectories; "
            "choose a smaller k or give more scenes."
        )
    flat = futures.reshape(len(futures), -1)
    distinct = len(np.unique(np.round(flat, 6), axis=0))
    if distinct < k:
        raise DataError(f"Only {distinct} of the trajectories differ; choose a k of at most that.")
    if method != "kmeans":
        return _chosen(futures, choose_templates(futures, k, seed, dt_s, method), seed, dt_s)
    clusters = cluster(flat, k, seed)
    points = clusters.centres.reshape(k, *futures.shape[1:]).astype(np.float32)
    fitted = TemplateSet(points=points, dt_s=dt_s, counts=np.zeros(k, dtype=np.int64))
    counts = np.bincount(fitted.nearest(futures), minlength=k)
    said = "K-Means, from coarse to fine"
    return _template_set(points, dt_s, counts, seed, clusters.inertia, said)


def fit_templates_stream(
    chunks: Callable[[], Iterable[FloatArray]], k: int, seed: int, dt_s: float | None = None
) -> tuple[TemplateSet, FloatArray]:
    """Mini-batch K-Means centres of futures that need not fit into memory, most frequent first.

    The card says under `inertia_given_up_at_most` by which share the inertia may be greater than
    with `fit_templates`; see `clustering.cluster_stream`.

    Args:
        chunks: Begins the stream of [M, T, 2] chunks anew; it is read three times, and its
            beginning once more.
        k: Number of templates.
        seed: Of samples and choice.
        dt_s: Time between points of the futures; needed unless they are of 5 s, every 0.25 s.

    Returns:
        The templates; and a random sample [S, T, 2] of the futures that they were not chosen from.

    Raises:
        DataError: If there are fewer futures than templates, too few distinct ones, or futures that
            no car can have driven.
    """
    _check_seed(seed)
    first = next((chunk for chunk in chunks() if len(chunk)), None)
    if first is None or k < 1:
        raise DataError(
            f"Cannot fit {k} templates to {'no' if first is None else 'any'} trajectories."
        )
    shape, step_s = first.shape[1:], _time_step(first, dt_s)

    def flat_chunks() -> Iterator[FloatArray]:
        for chunk in chunks():
            check_futures(chunk, step_s)
            if len(chunk):
                yield chunk.reshape(len(chunk), -1)

    clusters = cluster_stream(flat_chunks, k, seed)
    points = clusters.centres.reshape(k, *shape).astype(np.float32)
    method = "mini-batch K-Means of a stream"
    templates = _template_set(points, step_s, clusters.counts, seed, clusters.inertia, method)
    card = templates.card | {"inertia_given_up_at_most": clusters.given_up}
    return replace(templates, card=card), clusters.sample.reshape(-1, *shape)


def _chosen(futures: FloatArray, choice: TemplateChoice, seed: int, dt_s: float) -> TemplateSet:
    """A template set of what another method than K-Means has made."""
    points = choice.points.astype(np.float32)
    made = TemplateSet(points, dt_s, np.zeros(len(points), dtype=np.int64))
    nearest = made.nearest(futures)
    inertia_m2 = float(((futures - points[nearest]) ** 2).sum())
    counts = np.bincount(nearest, minlength=len(points))
    made = _template_set(points, dt_s, counts, seed, inertia_m2, choice.method)
    return replace(made, card=made.card | {"settings": choice.settings})


def _check_seed(seed: int) -> None:
    if not 0 <= seed <= MAX_SEED:
        raise DataError(f"The seed must lie in 0 to {MAX_SEED}, got {seed}.")


def _time_step(futures: FloatArray, dt_s: float | None) -> float:
    """Time between points of futures: as given, or as futures are mined."""
    if dt_s is None:
        num_points = round(HORIZON_S / DT_S)
        if futures.ndim == 3 and futures.shape[1] != num_points:
            raise DataError(
                f"Futures of {futures.shape[1]} points are not those of {HORIZON_S:g} s every "
                f"{DT_S:g} s, which have {num_points}; say the time between their points (dt_s)."
            )
        dt_s = DT_S
    check_futures(futures, dt_s)
    return dt_s


def _template_set(
    points: NDArray[np.float32],
    dt_s: float,
    counts: NDArray[np.int64],
    seed: int,
    inertia_m2: float,
    method: str,
) -> TemplateSet:
    order = np.argsort(-counts, kind="stable")
    return TemplateSet(
        points=points[order],
        dt_s=dt_s,
        counts=counts[order],
        card={
            "k": len(points),
            "seed": seed,
            "method": method,
            "num_futures": int(counts.sum()),
            "inertia_m2": inertia_m2,
            "libraries": {name: version(name) for name in ("numpy", "scikit-learn")},
        },
    )
