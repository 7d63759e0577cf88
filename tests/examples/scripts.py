"""Loads the scripts in examples/ as modules: those that a script imports from beside it are found."""

import importlib
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import pytest

EXAMPLES = Path(__file__).parents[2] / "examples"


def load_script(path: str) -> ModuleType:
    """A script by its path from examples/, loaded anew."""
    return _load(path, importlib.reload)


def share_script(path: str) -> ModuleType:
    """The same module that other scripts import."""
    return _load(path, lambda module: module)


def _load(path: str, renew: Callable[[ModuleType], ModuleType]) -> ModuleType:
    file = EXAMPLES / path
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(file.parent))
        return renew(importlib.import_module(file.stem))
