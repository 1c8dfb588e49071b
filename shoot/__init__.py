"""Shoot: from a bird's-eye-view cost map to ranked ego trajectories (the paper's section 3.3)."""

import lazy_loader

__version__ = "0.1.0"

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
