"""Who is about, and where everybody is at one moment."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from shoot.world.town.town import FloatArray

Kind = Literal["car", "truck", "pedestrian"]


@dataclass(frozen=True)
class EgoBody:
    """What others see of the ego.

    Attributes:
        xy_m: [2] rear axle, in the town's frame.
        yaw_rad: Heading.
        speed_mps: Forward.
    """

    xy_m: FloatArray
    yaw_rad: float
    speed_mps: float


@dataclass(frozen=True)
class Cast:
    """Everybody but the ego: A of them, the cars first.

    Attributes:
        kinds: [A].
        sizes_m: [A, 3] length, width, height of their boxes.
        styles: [A] any integers; they pick the colours.
    """

    kinds: tuple[Kind, ...]
    sizes_m: FloatArray
    styles: tuple[int, ...]


@dataclass(frozen=True)
class Bodies:
    """Everybody but the ego at one moment, in the order of the cast.

    Attributes:
        xy_m: [A, 2] centres of their boxes, in the town's frame.
        yaw_rad: [A] headings.
        speed_mps: [A].
        is_braking: [A] whether brake lights are lit.
    """

    xy_m: FloatArray
    yaw_rad: FloatArray
    speed_mps: FloatArray
    is_braking: NDArray[np.bool_]
