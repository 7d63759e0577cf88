"""Runs of scenarios, simulated and on devices, their recordings and replays; simulated grasps with ground truth."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
