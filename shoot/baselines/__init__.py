"""What any planner stands beside: what is known without looking, and from motion alone."""

from shoot.baselines.blind import BlindFit, fit_blind
from shoot.baselines.folds import scene_folds
from shoot.baselines.kinematic import (
    Spread,
    along_heading,
    constant_velocity_futures,
    constant_yaw_rate_futures,
    driving_on_log_prob,
    fit_spread,
    future_log_prob,
    standing_still_log_prob,
)
from shoot.baselines.past_motion import PastMotionFit, fit_past_motion
from shoot.baselines.past_motion_file import kept_past_motion
from shoot.baselines.prior import fit_prior, prior_log_prob
from shoot.baselines.speed_prior import SpeedPrior, fit_speed_prior

__all__ = [
    "BlindFit",
    "PastMotionFit",
    "SpeedPrior",
    "Spread",
    "along_heading",
    "constant_velocity_futures",
    "constant_yaw_rate_futures",
    "driving_on_log_prob",
    "fit_blind",
    "fit_past_motion",
    "fit_prior",
    "fit_speed_prior",
    "fit_spread",
    "future_log_prob",
    "kept_past_motion",
    "prior_log_prob",
    "scene_folds",
    "standing_still_log_prob",
]
