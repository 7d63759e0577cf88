"""Calibration of a hand: the errors that contacts of many grasps share, and the object's pose in each."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
