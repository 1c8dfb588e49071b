"""A run folder opened: what a planner or a segmentation says, as trained; planners also fast."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
