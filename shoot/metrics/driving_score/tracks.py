"""Who moved where: the ego's track and those of others, as plain arrays."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import numpy as np
from jaxtyping import Bool, Float

from shoot.footprint import (
    EGO_LENGTH_M,
    EGO_WIDTH_M,
    footprint_centres,
    footprint_corners,
    headings,
    rectangles_overlap,
)

Array = np.ndarray[Any, np.dtype[Any]]

Kind = Literal["car", "truck", "bicycle", "pedestrian", "object"]

EGO_SIZE_M = np.array([EGO_LENGTH_M, EGO_WIDTH_M])


@dataclass(frozen=True, eq=False)
class Track:
    """Where the ego was, evenly spaced in time.

    Attributes:
        xy_m: Rear axle, in any one frame of the ground (x, y to the left of x).
        yaw_rad: Heading, to the left of x.
        speed_mps: Along the heading; negative when reversing.
        dt_s: Time between steps. The thresholds on smoothed values are made for 0.1.
    """

    xy_m: Float[Array, "T 2"]
    yaw_rad: Float[Array, " T"]
    speed_mps: Float[Array, " T"]
    dt_s: float = 0.1

    def __post_init__(self) -> None:
        shapes = [list(self.xy_m.shape), list(self.yaw_rad.shape), list(self.speed_mps.shape)]
        steps = len(self.xy_m)
        if steps == 0 or shapes != [[steps, 2], [steps], [steps]]:
            raise ValueError(
                "A track must have positions [T, 2], headings [T] and speeds [T] for one or more "
                f"steps T, got {shapes}."
            )
        if not all(np.isfinite(a).all() for a in (self.xy_m, self.yaw_rad, self.speed_mps)):
            raise ValueError("A track must be finite: leave out the steps that are not known.")
        if not self.dt_s > 0.0:
            raise ValueError(f"dt_s must be more than 0 s, got {self.dt_s}.")

    def __len__(self) -> int:
        return len(self.xy_m)

    @cached_property
    def centre_m(self) -> Float[Array, "T 2"]:
        """Middle of the footprint."""
        return footprint_centres(self.xy_m, self.yaw_rad)

    @cached_property
    def corners_m(self) -> Float[Array, "T 4 2"]:
        """Corners of the footprint: front left, rear left, rear right, front right."""
        return footprint_corners(self.xy_m, self.yaw_rad)

    def part(self, first: int, end: int | None = None) -> "Track":
        """The steps from one on, to another that is not part of it if given."""
        steps = slice(first, end)
        return Track(self.xy_m[steps], self.yaw_rad[steps], self.speed_mps[steps], self.dt_s)

    def after(self, history: "Track") -> "Track":
        """The track with what came before it in front.

        Raises:
            ValueError: If the two have different time steps.
        """
        if abs(history.dt_s - self.dt_s) > 1e-9:
            raise ValueError(f"History has steps of {history.dt_s} s, the track of {self.dt_s} s.")
        return Track(
            np.concatenate([history.xy_m, self.xy_m]),
            np.concatenate([history.yaw_rad, self.yaw_rad]),
            np.concatenate([history.speed_mps, self.speed_mps]),
            self.dt_s,
        )

    def steps_in(self, seconds: float) -> int:
        """Steps in a stretch of time, rounded to whole ones."""
        return round(seconds / self.dt_s)


def track_of_plan(points_m: Float[Array, "T 2"], dt_s: float) -> Track:
    """A plan as a track that begins where it was made: T + 1 steps.

    Heading is the direction of the path, speed the distance from the point before to the point
    after. A plan that is driven by a controller is better given as what that made of it.

    Args:
        points_m: Rear axle in `ego`, the first at `dt_s`.
        dt_s: Time between points.
    """
    path_m = np.concatenate([np.zeros((1, 2)), points_m])
    yaw_rad = np.concatenate([[0.0], headings(points_m, dt_s)])
    velocity_mps = np.gradient(path_m, dt_s, axis=0) if len(path_m) > 1 else np.zeros((1, 2))
    speed_mps = velocity_mps[:, 0] * np.cos(yaw_rad) + velocity_mps[:, 1] * np.sin(yaw_rad)
    return Track(path_m, yaw_rad, speed_mps, dt_s)


@dataclass(frozen=True, eq=False)
class Others:
    """Everybody and everything that can be hit, at the ego's steps and, if known, some more.

    Attributes:
        centre_m: Middles of their boxes, in the frame of the ego's track.
        yaw_rad: Direction of their length.
        speed_mps: Amount; 0 for what stands.
        size_m: Length and width.
        is_present: Where they are known. What is not present is nowhere.
        kinds: One each. A parked car is a "car"; "object" is what no one steers: a cone, a barrier.
    """

    centre_m: Float[Array, "A S 2"]
    yaw_rad: Float[Array, "A S"]
    speed_mps: Float[Array, "A S"]
    size_m: Float[Array, "A 2"]
    is_present: Bool[Array, "A S"]
    kinds: tuple[Kind, ...]

    def __post_init__(self) -> None:
        num, steps = self.yaw_rad.shape
        got = [a.shape for a in (self.centre_m, self.speed_mps, self.size_m, self.is_present)]
        wanted = [(num, steps, 2), (num, steps), (num, 2), (num, steps)]
        if got != wanted or len(self.kinds) != num:
            raise ValueError(
                f"Others must be centres [A, S, 2], headings, speeds and presence [A, S], sizes "
                f"[A, 2] and A kinds, got {[list(shape) for shape in got]} and "
                f"{len(self.kinds)} kinds beside headings {[num, steps]}."
            )

    def __len__(self) -> int:
        return len(self.kinds)

    @cached_property
    def is_agent(self) -> Bool[Array, " A"]:
        """Those that someone steers or that walk, as against things."""
        return np.array([kind != "object" for kind in self.kinds], dtype=bool)

    def overlap(
        self,
        centre_m: Float[Array, "T 2"],
        yaw_rad: Float[Array, " T"],
        size_m: Float[Array, " 2"] = EGO_SIZE_M,
        delay: int = 0,
    ) -> Bool[Array, "A T"]:
        """Whether a rectangle at step t shares ground with each other at step t + `delay`."""
        then = slice(delay, delay + len(yaw_rad))
        overlap = rectangles_overlap(
            centre_m[None],
            yaw_rad[None],
            size_m[None, None],
            self.centre_m[:, then],
            self.yaw_rad[:, then],
            self.size_m[:, None],
        )
        return np.asarray(overlap & self.is_present[:, then])


def no_others(num_steps: int) -> Others:
    """An empty town."""
    none = np.zeros((0, num_steps))
    return Others(
        np.zeros((0, num_steps, 2)), none, none, np.zeros((0, 2)), np.zeros_like(none, bool), ()
    )
