"""How a hand can hold an object: the reach of fingers, the choice of a grasp, and the law that closes it."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
