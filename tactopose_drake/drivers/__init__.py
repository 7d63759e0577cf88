"""Sensors on CAN buses, with python-can: drivers, simulated devices with the same protocols, recording, replay.

And what other processes say and hear over LCM and ROS 2: the messages, and who receives them.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
