"""A trained planner as one file for other runtimes, and what such a file needs beside it."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
