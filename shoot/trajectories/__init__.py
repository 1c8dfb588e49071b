"""Where the ego goes from a moment on, and where it came from: mined from recorded poses."""

from shoot.trajectories.futures import (
    DT_S,
    HORIZON_S,
    MAX_SPEED_MPS,
    Futures,
    check_futures,
    futures_from_poses,
    whole_steps,
)
from shoot.trajectories.mining import mine_futures
from shoot.trajectories.past import PAST_DT_S, PAST_S, past_from_poses

__all__ = [
    "DT_S",
    "HORIZON_S",
    "MAX_SPEED_MPS",
    "PAST_DT_S",
    "PAST_S",
    "Futures",
    "check_futures",
    "futures_from_poses",
    "mine_futures",
    "past_from_poses",
    "whole_steps",
]
