"""Paths of models and diagrams, the resolution of `package://` URLs, and reading YAML files into dataclasses."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
