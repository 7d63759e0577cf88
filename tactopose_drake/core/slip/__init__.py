"""Whether the object slips: by forces, by how the fingertips move, and by how its surface does."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
