"""Drawings of estimates and contacts: in Meshcat, as PNG pictures without a display, and as web pages."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
