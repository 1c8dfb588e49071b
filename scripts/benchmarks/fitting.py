"""1000 templates of 200,000 futures: from coarse to fine against scikit-learn's K-Means."""

from collections.abc import Callable

import numpy as np
from sklearn.cluster import KMeans

from lss_core.geometry import FloatArray
from shoot.clustering import Clusters, StreamClusters, cluster, cluster_stream
from shoot.trajectories import futures_from_poses

NUM_FUTURES = 200_000
NUM_TEMPLATES = 1000
_SWEEP_S = 0.05
_SCENE_S = 20.0


def futures(num: int = NUM_FUTURES, seed: int = 0) -> FloatArray:
    """[M, 40] futures of cars that speed up, brake, stand and turn at random; scene by scene."""
    rng = np.random.default_rng(seed)
    time_s = np.arange(0.0, _SCENE_S + 1e-9, _SWEEP_S)
    starts_s = time_s[time_s <= _SCENE_S - 5.0]
    parts: list[FloatArray] = []
    for _ in range(-(-num // len(starts_s))):
        xy_m, yaw_rad = _drive(rng, len(time_s))
        parts.append(futures_from_poses(time_s, xy_m, yaw_rad, starts_s)[0])
    return np.concatenate(parts)[:num].reshape(num, -1)


def _drive(rng: np.random.Generator, num_steps: int) -> tuple[FloatArray, FloatArray]:
    """Positions and headings of one scene: aims at a new speed and bend every few seconds."""
    num_aims = num_steps // 80 + 2
    wanted_mps = np.where(rng.random(num_aims) < 0.2, 0.0, rng.uniform(0.0, 14.0, num_aims))
    straight = rng.random(num_aims) < 0.6
    bend_pm = np.where(straight, rng.normal(0.0, 0.002, num_aims), rng.normal(0.0, 0.06, num_aims))
    aim = np.arange(num_steps) // 80
    speed_mps, curvature_pm = np.zeros(num_steps), np.zeros(num_steps)
    speed, curvature = wanted_mps[0], bend_pm[0]
    for step in range(num_steps):
        speed += np.clip(wanted_mps[aim[step]] - speed, -3.0 * _SWEEP_S, 2.0 * _SWEEP_S)
        curvature += np.clip(bend_pm[aim[step]] - curvature, -0.04 * _SWEEP_S, 0.04 * _SWEEP_S)
        speed_mps[step], curvature_pm[step] = speed, curvature
    yaw_rad = np.cumsum(np.clip(speed_mps * curvature_pm, -0.6, 0.6)) * _SWEEP_S
    velocity_mps = speed_mps[:, None] * np.stack([np.cos(yaw_rad), np.sin(yaw_rad)], axis=-1)
    return np.cumsum(velocity_mps, axis=0) * _SWEEP_S, yaw_rad


def plain_fit() -> Callable[[], Clusters]:
    """scikit-learn's K-Means as it comes."""
    points = futures()

    def run() -> Clusters:
        means = KMeans(NUM_TEMPLATES, random_state=0).fit(points)
        return Clusters(means.cluster_centers_, float(means.inertia_))

    return run


def fast_fit() -> Callable[[], Clusters]:
    """What `fit_templates` does."""
    points = futures()
    return lambda: cluster(points, NUM_TEMPLATES, 0)


def stream_fit() -> Callable[[], StreamClusters]:
    """What `fit_templates_stream` does, in chunks of ten scenes."""
    points = futures()
    chunks = np.array_split(points, 70)
    return lambda: cluster_stream(lambda: chunks, NUM_TEMPLATES, 0)
