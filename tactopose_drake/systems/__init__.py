"""LeafSystems, one a file, each with a thin body around one call into core."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
