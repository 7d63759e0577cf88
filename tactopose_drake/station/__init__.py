"""Scenarios as data, and the Diagrams built from them: simulated, on devices, from recordings, and on an arm."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
