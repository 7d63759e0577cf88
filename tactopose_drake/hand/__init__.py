"""Hands: their YAML files, geometry, kinematics, collision, fingertip weights, tactile pads and calibration."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
