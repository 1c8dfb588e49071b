"""Lift and Splat: images of any camera rig to one bird's-eye-view map (the paper's sections 3.1 and 3.2)."""
