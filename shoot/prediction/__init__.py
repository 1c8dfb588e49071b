"""A run folder opened: log-probabilities, as trained or as fast as this machine can."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
