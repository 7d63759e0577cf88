"""Estimates and touches in Meshcat, as pictures without a display, and as pages."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
