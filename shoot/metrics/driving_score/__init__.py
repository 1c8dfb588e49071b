"""How well a car was driven, by the rules of EPDMS: pure functions of arrays, any simulator's."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
