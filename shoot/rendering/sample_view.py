"""Everything one picture of one sample shows."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from jaxtyping import Float, UInt8

from lss_core.config import CAMERAS
from lss_core.grid import BevGrid

FloatArray = np.ndarray[Any, np.dtype[np.floating[Any]]]


@dataclass(frozen=True)
class SampleView:
    """One sample as arrays; whatever is None is left out of the picture.

    Attributes:
        images: One RGB image per camera.
        pixel_from_camera: Intrinsics for exactly these images (resize and crop folded in).
        ego_from_camera: Pose of each camera in `ego`.
        camera_names: Name per image; the six of nuScenes find their usual places.
        grid: Where the cost map lies.
        cost_map: Dimensionless cost; X forward, Y left; low is good.
        templates: Waypoints (x, y) in `ego`, in metres, one every `dt_s`, the first at `dt_s`.
        probabilities: Probability of each template.
        driven: The path really driven, as waypoints like those of a template.
        lidar_points_ego: A sweep in `ego`, in metres.
        dt_s: Time between waypoints.
        num_best: How many of the most probable templates are drawn.
        title: Headline.
        caption: Small print below it: sample token, scene, weather.

    Raises:
        ValueError: If sizes do not belong together, or templates come without probabilities.
    """

    images: UInt8[np.ndarray[Any, np.dtype[np.uint8]], "N H W 3"]
    pixel_from_camera: Float[FloatArray, "N 3 3"]
    ego_from_camera: Float[FloatArray, "N 4 4"]
    camera_names: tuple[str, ...] = CAMERAS
    grid: BevGrid = field(default_factory=BevGrid)
    cost_map: Float[FloatArray, "X Y"] | None = None
    templates: Float[FloatArray, "K T 2"] | None = None
    probabilities: Float[FloatArray, " K"] | None = None
    driven: Float[FloatArray, "T 2"] | None = None
    lidar_points_ego: Float[FloatArray, "P 3"] | None = None
    dt_s: float = 0.25
    num_best: int = 10
    title: str = ""
    caption: str = ""

    def __post_init__(self) -> None:
        check_cameras(self.camera_names, self.images, self.pixel_from_camera, self.ego_from_camera)
        if self.cost_map is not None and self.cost_map.shape != self.grid.shape:
            raise ValueError(
                f"The cost map has {self.cost_map.shape} cells, its grid {self.grid.shape}."
            )
        if (self.templates is None) != (self.probabilities is None):
            raise ValueError("Templates and their probabilities are drawn together or not at all.")
        if (
            self.templates is not None
            and self.probabilities is not None
            and len(self.templates) != len(self.probabilities)
        ):
            raise ValueError(
                f"{len(self.templates)} templates need as many probabilities, "
                f"got {len(self.probabilities)}."
            )
        if (
            self.templates is not None
            and self.driven is not None
            and self.templates.shape[1:] != self.driven.shape
        ):
            raise ValueError(
                f"Templates of {self.templates.shape[1]} waypoints cannot be compared with a "
                f"driven path of {len(self.driven)}."
            )


@dataclass(frozen=True)
class Ranking:
    """The most probable templates of a view, best first.

    Attributes:
        paths_m: Waypoints of the best R templates, each starting at the ego origin.
        probabilities: Their probabilities.
        strengths: Their probabilities for the eye: 1 for the best, falling in proportion.
        num_templates: How many there are in all.
        driven_rank: Rank (1 is best) of the template nearest to the driven path, if there is one.
        driven_probability: That template's probability.
        driven_distance_m: Mean distance between its waypoints and the driven ones.
    """

    paths_m: Float[FloatArray, "R T_1 2"]
    probabilities: Float[FloatArray, " R"]
    strengths: Float[FloatArray, " R"]
    num_templates: int
    driven_rank: int | None = None
    driven_probability: float | None = None
    driven_distance_m: float | None = None


def rank(view: SampleView) -> Ranking | None:
    """Sort a view's templates by probability, or None if it has none."""
    if view.templates is None or view.probabilities is None or len(view.templates) == 0:
        return None
    order = np.argsort(-view.probabilities, kind="stable")
    best = order[: view.num_best]
    probabilities = view.probabilities[best].astype(np.float64)
    ranking = Ranking(
        paths_m=np.stack([from_origin(view.templates[k]) for k in best]),
        probabilities=probabilities,
        strengths=probabilities / max(float(probabilities[0]), 1e-12),
        num_templates=len(order),
    )
    if view.driven is None:
        return ranking
    gaps_m = view.templates.astype(np.float64) - view.driven
    nearest = int(np.argmin((gaps_m**2).sum(axis=(1, 2))))
    return Ranking(
        paths_m=ranking.paths_m,
        probabilities=ranking.probabilities,
        strengths=ranking.strengths,
        num_templates=ranking.num_templates,
        driven_rank=int(np.flatnonzero(order == nearest)[0]) + 1,
        driven_probability=float(view.probabilities[nearest]),
        driven_distance_m=float(np.linalg.norm(gaps_m[nearest], axis=-1).mean()),
    )


def from_origin(waypoints_m: Float[FloatArray, "T 2"]) -> Float[FloatArray, "T_1 2"]:
    """The waypoints with the ego's present place, (0, 0), before them."""
    path: FloatArray = np.concatenate([np.zeros((1, 2)), waypoints_m.astype(np.float64)])
    return path


def check_cameras(names: tuple[str, ...], *of_each: np.ndarray[Any, np.dtype[Any]]) -> None:
    """Check that there is one of everything for each of N cameras.

    Args:
        names: Of the cameras.
        of_each: Images, intrinsics and poses.

    Raises:
        ValueError: If not.
    """
    given = tuple(len(values) for values in of_each)
    if given != (len(names),) * len(given):
        raise ValueError(
            f"A view of {len(names)} cameras needs as many images, intrinsics and poses, got "
            f"{given}."
        )
