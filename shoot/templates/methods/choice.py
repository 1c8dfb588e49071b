"""Methods of making templates by name, and what each says of itself."""

from dataclasses import dataclass, field
from typing import Any, Literal

from lss_core.errors import DataError
from lss_core.geometry import FloatArray
from shoot.templates.methods import medoids as k_medoids
from shoot.templates.methods.cover import CANDIDATES_PER_TEMPLATE, fit_cover
from shoot.templates.methods.distinct import distinct_futures
from shoot.templates.methods.factored import SPARE, fit_factored
from shoot.templates.methods.farthest import farthest_points

Method = Literal["kmeans", "farthest", "cover", "medoids", "factored"]


@dataclass(frozen=True)
class TemplateChoice:
    """Templates that a method has made.

    Attributes:
        points: [K, T, 2] metres in `ego`.
        method: What it is, in words.
        settings: What it was told beside k and seed, and what it found.
    """

    points: FloatArray
    method: str
    settings: dict[str, Any] = field(default_factory=dict)


def choose_templates(
    futures: FloatArray, k: int, seed: int, dt_s: float, method: Method
) -> TemplateChoice:
    """K templates by another method than K-Means; the order of the futures plays no part.

    Args:
        futures: [M, T, 2] metres in `ego`.
        k: Number of templates.
        seed: Of K-Means in `medoids` and `factored`; in the others there is no chance.
        dt_s: Time between points.
        method: Any but `kmeans`, which `fit_templates` does itself.

    Raises:
        DataError: If fewer than k differ, or too few products of paths and speeds do.
        ValueError: If the method is none of these.
    """
    distinct = distinct_futures(futures)
    if len(distinct.points) < k:
        raise DataError(
            f"Only {len(distinct.points)} of the trajectories differ; choose a k of at most that."
        )
    if method == "farthest":
        rows = farthest_points(distinct.flat, k).rows
        settings: dict[str, Any] = {"first": "nearest to the mean"}
        return TemplateChoice(distinct.points[rows], "farthest-point sampling", settings)
    if method == "cover":
        found = fit_cover(distinct, k)
        settings = {
            "epsilon_m": found.epsilon_m,
            "num_covering": found.num_covering,
            "candidates_per_template": CANDIDATES_PER_TEMPLATE,
        }
        return TemplateChoice(distinct.points[found.rows], "greedy cover", settings)
    if method == "medoids":
        rows = k_medoids.medoids(distinct, k, seed)
        settings = {"max_rounds": k_medoids.MAX_ROUNDS, "candidates": k_medoids.CANDIDATES}
        return TemplateChoice(distinct.points[rows], "k-medoids by alternation", settings)
    if method == "factored":
        made = fit_factored(distinct, k, seed, dt_s)
        settings = {
            "num_paths": len(made.paths_rad),
            "num_profiles": len(made.profiles_m),
            "products_per_template": SPARE,
        }
        return TemplateChoice(made.points, "paths x speed profiles", settings)
    raise ValueError(f"There is no method '{method}' of choosing templates.")
