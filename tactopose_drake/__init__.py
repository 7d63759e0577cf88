"""Touch-based pose estimation of grasped objects, as systems for Drake."""

import importlib
from typing import Any

import lazy_loader

_public, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
_ROOMS = frozenset({
    "cli", "core", "drivers", "errors", "estimation", "hand", "resources", "runs", "station", "systems",
    "visualization",
})  # fmt: skip


def __getattr__(name: str) -> Any:
    """A public name, or one of the package's parts, imported when it is first asked for."""
    return importlib.import_module(f"{__name__}.{name}") if name in _ROOMS else _public(name)
