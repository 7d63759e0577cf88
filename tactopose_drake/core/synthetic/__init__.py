"""Touches of known truth: contacts and patches sampled on an object, and contacts that roll on it."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
