"""From a file to a closed, oriented triangle mesh, with every repair stated."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
