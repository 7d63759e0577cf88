"""The mathematics: functions and frozen dataclasses over arrays; no pydrake, no clock, no global random state."""

import importlib
from types import ModuleType

_ROOMS = frozenset({
    "calibration", "evidence", "exploration", "grasping", "identification", "kernels", "mesh", "motion", "objectives",
    "posterior", "searches", "sensing", "shape", "slip", "surfaces", "synthetic", "tracking", "vision",
})  # fmt: skip


def __getattr__(name: str) -> ModuleType:
    """Imports a subpackage when it is first accessed."""
    if name not in _ROOMS:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return importlib.import_module(f"{__name__}.{name}")
