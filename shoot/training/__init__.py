"""From data and templates to a run folder: settings, data, loop, and all that a run leaves."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
