"""A camera in place of touch: depth images, what the hand hides, and a tracker on them."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
