"""Where models and diagrams lie, how `package://` URLs resolve, and YAML files read into dataclasses."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
