"""What moved: the tracks of one 20 s scene, as traffic left them and before any sensor saw them."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from shoot.world.town.town import FloatArray

RED, AMBER, GREEN = 0, 1, 2
# Cameras draw road users up to here, and a recording keeps all who ever come nearer: were the cut
# seen, someone far off would appear or vanish with the ego's hidden way.
AGENT_SIGHT_M = 140.0


@dataclass(frozen=True)
class Agent:
    """A road user other than the ego.

    Attributes:
        kind: nuScenes calls them vehicle.car, vehicle.truck, human.pedestrian.adult.
        size_m: [3] length, width, height of its box.
        style: Any integer; picks the colours.
        xy_m: [T, 2] centre of the box, in the town's frame.
        yaw_rad: [T] heading.
        speed_mps: [T].
        is_braking: [T] whether its brake lights are lit (also while it stands in traffic).
        is_present: [T] False before it enters and after it leaves the town.
    """

    kind: Literal["car", "truck", "pedestrian"]
    size_m: FloatArray
    style: int
    xy_m: FloatArray
    yaw_rad: FloatArray
    speed_mps: FloatArray
    is_braking: NDArray[np.bool_]
    is_present: NDArray[np.bool_]


@dataclass(frozen=True)
class Recording:
    """Tracks of one scene, every `dt_s` from 0 s.

    Attributes:
        dt_s: Step, 0.05 s (the lidar's 20 Hz).
        ego_xy_m: [T, 2] rear axle of the ego car.
        ego_yaw_rad: [T], continuous (unwrapped).
        ego_speed_mps: [T].
        ego_lane: [T] lane or path it is on, index into `Town.lanes`.
        agents: All others.
        signal_state: [T, len(Town.signals)] RED, AMBER or GREEN.
    """

    dt_s: float
    ego_xy_m: FloatArray
    ego_yaw_rad: FloatArray
    ego_speed_mps: FloatArray
    ego_lane: NDArray[np.int64]
    agents: tuple[Agent, ...]
    signal_state: NDArray[np.int64]


@dataclass(frozen=True)
class Look:
    """Light and weather of a scene.

    Attributes:
        daylight: `day`, `dusk` or `night`.
        is_raining: Wet road, grey sky, drops.
        sun_azimuth_rad: Where the light comes from, in the town's frame.
    """

    daylight: Literal["day", "dusk", "night"]
    is_raining: bool
    sun_azimuth_rad: float
