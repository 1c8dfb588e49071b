"""A planner beside its baselines on a split: from log-probabilities to a report."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
