"""Poses of cars that drive, worked out from speed and curvature."""

from collections.abc import Callable
from typing import Any

import numpy as np

from lss_core.data.tables.tracks import Tracks
from lss_core.geometry import rigid_from_yaw


def tracks_of(
    times_s: np.ndarray, places_m: np.ndarray, yaw_rad: np.ndarray, scene: int = 0
) -> Tracks:
    poses = rigid_from_yaw(places_m, yaw_rad)
    return Tracks(times_s + 1.5e9, np.full(len(times_s), scene, dtype=np.int64), poses)


def joined(parts: list[Tracks]) -> Tracks:
    names = ("time_s", "scene", "global_from_ego")
    return Tracks(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


def driven(
    seconds: float, speed_mps: Callable[[Any], Any], curvature_pm: Callable[[Any], Any]
) -> Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]:
    """Places and headings over time of a rear axle that follows a curvature at a speed."""
    fine_s = np.linspace(0.0, seconds, 40_001)
    step_s = fine_s[1]
    speed = speed_mps(fine_s) * np.ones_like(fine_s)
    yaw_rad = 0.8 + np.cumsum(speed * curvature_pm(fine_s)) * step_s
    xy_m = np.cumsum(np.stack([np.cos(yaw_rad), np.sin(yaw_rad)], axis=-1) * speed[:, None], 0)
    xy_m = xy_m * step_s + [500_123.0, 5_400_456.0]

    def at(times_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        places = np.stack([np.interp(times_s, fine_s, xy_m[:, axis]) for axis in (0, 1)], axis=-1)
        return places, np.interp(times_s, fine_s, yaw_rad)

    return at


DRIVES = {
    "straight": driven(20.0, lambda t: 30.0, lambda t: 0.0),
    "standing": driven(20.0, lambda t: 0.0, lambda t: 0.0),
    "hard braking": driven(20.0, lambda t: np.clip(30.0 - 10.0 * (t - 5.0), 0, 30), lambda t: 0.0),
    "starting": driven(20.0, lambda t: np.clip(4.0 * (t - 3.0), 0.0, 20.0), lambda t: 0.001),
    "parking": driven(20.0, lambda t: 1.5, lambda t: np.sign(np.sin(0.9 * t)) / 3.2),
    "roundabout": driven(20.0, lambda t: 8.0, lambda t: np.where((t > 4) & (t < 14), 1 / 12, 0)),
    "tight circle": driven(20.0, lambda t: 4.5, lambda t: 1 / 4.0),
    "slalom": driven(20.0, lambda t: 15.0, lambda t: 0.03 * np.sin(2.0 * t)),
    "reversing": driven(20.0, lambda t: np.where(t < 8, 5.0, -2.6), lambda t: 0.05),
    "only reversing": driven(20.0, lambda t: -3.0, lambda t: 0.03),
}
