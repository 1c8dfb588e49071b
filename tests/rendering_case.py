"""A made-up sample seen by six cameras, for tests of pictures."""

import numpy as np
from matplotlib.figure import Figure

from lss_core.grid import BevGrid
from shoot.rendering import SampleView

# A camera 1.5 m above the ego origin that looks forward: (x, y, 0) is seen at
# u = 80 - 100 y / x, v = 60 + 150 / x.
PIXEL_FROM_CAMERA = np.array([[100.0, 0.0, 80.0], [0.0, 100.0, 60.0], [0.0, 0.0, 1.0]])
FORWARD = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
IMAGE_HW = (120, 160)
REFUSED = (ValueError, TypeError)  # shape types, active in tests, may speak first
TIMES_S = 0.25 * np.arange(1, 21)


def looking(yaw_rad: float) -> np.ndarray:
    cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
    ego_from_camera = np.eye(4)
    ego_from_camera[:3, :3] = np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1.0]]) @ FORWARD
    ego_from_camera[2, 3] = 1.5
    return ego_from_camera


def straight(speed_mps: float, slope: float = 0.0) -> np.ndarray:
    x_m = speed_mps * TIMES_S
    return np.stack([x_m, slope * x_m], axis=-1)


def make_view(**changes: object) -> SampleView:
    grid = BevGrid(-50.0, 50.0, -50.0, 50.0, 2.0)
    left, ahead, right = straight(5.0, 0.8), straight(6.0), straight(5.0, -0.8)
    fields: dict[str, object] = {
        "images": np.full((6, *IMAGE_HW, 3), 128, np.uint8),
        "pixel_from_camera": np.tile(PIXEL_FROM_CAMERA, (6, 1, 1)),
        "ego_from_camera": np.stack(
            [looking(np.deg2rad(d)) for d in (55.0, 0.0, -55.0, 110.0, 180.0, -110.0)]
        ),
        "grid": grid,
        "cost_map": np.linspace(0.0, 1.0, 2500).reshape(50, 50),
        "templates": np.stack([left, ahead, right]),
        "probabilities": np.array([0.5, 0.3, 0.2]),
        "driven": straight(6.2),
        "title": "scene",
        "caption": "day",
    }
    return SampleView(**{**fields, **changes})  # type: ignore[arg-type]


def map_axes(figure: Figure):
    (axes,) = [a for a in figure.axes if a.get_xlabel() == "y: left (m)"]
    return axes
