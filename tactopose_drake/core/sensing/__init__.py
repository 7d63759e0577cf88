"""What fingertips feel: force and torque at a known surface, and pressure on arrays of cells."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
