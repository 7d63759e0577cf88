"""What is known of a hand: its YAML, geometry, kinematics, collision, fingertip weights and tactile pads."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
