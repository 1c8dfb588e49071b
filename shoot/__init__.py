"""Shoot: from a bird's-eye-view cost map to ranked ego trajectories (the paper's section 3.3)."""

__version__ = "0.1.0"
