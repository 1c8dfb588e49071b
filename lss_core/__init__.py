"""Lift and Splat: images of any camera rig to one bird's-eye-view map (the paper's 3.1, 3.2)."""
