"""Templates: the K trajectories a planner chooses from, where they come from, where they go."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
