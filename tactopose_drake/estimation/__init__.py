"""The calls that need Drake's types: estimates, identification, libraries, files, MathematicalPrograms."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
