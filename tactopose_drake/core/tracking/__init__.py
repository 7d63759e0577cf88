"""The belief of an object's pose over time: predicted from motion, updated by touch and vision."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
