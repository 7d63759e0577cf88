"""Convex fingertip surfaces, S(p) = 0, with gradient and Hessian."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
