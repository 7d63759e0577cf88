"""Which object is touched: an index over the pair features of a library, and the evidence for each object."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
