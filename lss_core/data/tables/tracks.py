"""The poses of several scenes as arrays, and how the car moves along them."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lss_core.geometry import FloatArray, direction_of, wrap_angle, yaw_of

# Motion is looked at over this much time: within a twentieth of a second places are noise.
_STRETCH_S = 0.4
_LONGEST_S = 2.1
_EVERY_S = 0.2
# Slower, places of a car that stands seem to move. In tighter turns its parts move in different
# directions: at a radius of 10 m the nose, 3 m before the rear axle, by 17 degrees.
_SLOWEST_MPS = 2.0
_TIGHTEST_PM = 0.1


@dataclass(frozen=True)
class Steps:
    """From each of P poses to the next, [P - 1]; 0 where the next is another scene's.

    Attributes:
        elapsed_s: Time.
        moved_m: Distance in the ground plane.
        turned_rad: Change of heading, in [-pi, pi).
    """

    elapsed_s: FloatArray
    moved_m: FloatArray
    turned_rad: FloatArray


@dataclass(frozen=True)
class Motion:
    """M stretches of about half a second, of at least 2 m/s and not in a tight turn.

    Attributes:
        scene: [M].
        lasts_s: [M] time until the next one, at most 0.5 s.
        speed_mps: [M].
        direction_rad: [M] in which the ego's origin moves, in `global`.
        angle_rad: [M] from there to the ego's x axis, positive where that points left of it.
        middle: [M] row of a pose in the middle.
    """

    scene: NDArray[np.int64]
    lasts_s: FloatArray
    speed_mps: FloatArray
    direction_rad: FloatArray
    angle_rad: FloatArray
    middle: NDArray[np.int64]


@dataclass(frozen=True)
class Tracks:
    """P poses, one scene after the other, each increasing in time.

    Attributes:
        time_s: [P].
        scene: [P] row of the scene, not decreasing.
        global_from_ego: [P, 4, 4].
    """

    time_s: FloatArray
    scene: NDArray[np.int64]
    global_from_ego: FloatArray

    @cached_property
    def place_m(self) -> FloatArray:
        """[P, 3] ego origin in `global`."""
        return np.ascontiguousarray(self.global_from_ego[:, :3, 3])

    @cached_property
    def yaw_rad(self) -> FloatArray:
        """[P] heading in `global`."""
        return yaw_of(self.global_from_ego)

    @cached_property
    def starts(self) -> NDArray[np.int64]:
        """Rows of the first poses of the scenes that have any."""
        rows: NDArray[np.int64] = np.flatnonzero(np.diff(self.scene, prepend=-1))
        return rows

    @cached_property
    def ends(self) -> NDArray[np.int64]:
        """Rows of their last poses."""
        ends: NDArray[np.int64] = np.append(self.starts, len(self.time_s))[1:] - 1
        return ends

    @cached_property
    def steps(self) -> Steps:
        """From pose to pose."""
        within = np.diff(self.scene) == 0
        return Steps(
            np.where(within, np.diff(self.time_s), 0.0),
            np.where(within, np.hypot(*np.diff(self.place_m[:, :2], axis=0).T), 0.0),
            np.where(within, wrap_angle(np.diff(self.yaw_rad)), 0.0),
        )

    @cached_property
    def motion(self) -> Motion:
        """Where the car drives, and its heading against that.

        The direction from one place to another on an arc is the mean of the headings there.
        """
        lengths = self.ends - self.starts + 1
        since_s = self.time_s - np.repeat(self.time_s[self.starts], lengths)
        # One axis of time on which the scenes lie apart.
        axis_s = since_s + self.scene * (since_s.max(initial=0.0) + 2.0 * _STRETCH_S)
        ahead = np.searchsorted(axis_s, axis_s + _STRETCH_S - 1e-6)
        ahead = np.minimum(ahead, np.repeat(self.ends, lengths))
        elapsed_s = axis_s[ahead] - axis_s
        way_m = self.place_m[ahead, :2] - self.place_m[:, :2]
        moved_m = np.hypot(*way_m.T)
        is_whole = (elapsed_s >= 0.5 * _STRETCH_S) & (elapsed_s <= _LONGEST_S)
        speed_mps = np.where(is_whole, moved_m / np.where(is_whole, elapsed_s, 1.0), 0.0)
        direction_rad = direction_of(way_m)
        bend_rad = np.abs(wrap_angle(direction_rad[ahead] - direction_rad))
        is_bent = (bend_rad > _TIGHTEST_PM * moved_m) & (speed_mps[ahead] > 0.5 * _SLOWEST_MPS)
        # A few of a second are enough, whatever the rate of the poses.
        is_first = np.diff(np.floor(since_s / _EVERY_S), prepend=-1.0) != 0.0
        is_first[self.starts] = True
        firsts = np.flatnonzero(is_first)
        lasts_s = np.minimum(np.diff(axis_s[firsts], append=np.inf), 0.5)
        chosen = ((speed_mps >= _SLOWEST_MPS) & ~is_bent)[firsts]
        rows = firsts[chosen]
        half_turn_rad = 0.5 * wrap_angle(self.yaw_rad[ahead[rows]] - self.yaw_rad[rows])
        return Motion(
            scene=self.scene[rows],
            lasts_s=lasts_s[chosen],
            speed_mps=speed_mps[rows],
            direction_rad=direction_rad[rows],
            angle_rad=wrap_angle(self.yaw_rad[rows] + half_turn_rad - direction_rad[rows]),
            middle=(rows + ahead[rows]) // 2,
        )

    def choose(self, scenes: list[int]) -> "Tracks":
        """Those of some scenes, under the same numbers."""
        own = np.isin(self.scene, scenes)
        return Tracks(self.time_s[own], self.scene[own], self.global_from_ego[own])
