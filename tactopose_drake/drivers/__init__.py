"""Sensors on CAN buses, with python-can: drivers, simulated devices with the same protocols, recording and replay.

Also messages to and from other processes over LCM and ROS 2.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
