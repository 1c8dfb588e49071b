"""Closed loop: a driver's plans move a car through the city, whose cameras show where it came."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
