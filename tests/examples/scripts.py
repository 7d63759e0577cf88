"""Loads the scripts in examples/ as modules: those that a script imports from beside it are found."""

import importlib
from pathlib import Path
from types import ModuleType

import pytest

EXAMPLES = Path(__file__).parents[2] / "examples"


def load_script(path: str) -> ModuleType:
    """A script by its path from examples/, loaded anew."""
    return importlib.reload(share_script(path))


def share_script(path: str) -> ModuleType:
    """The same module that other scripts import."""
    file = EXAMPLES / path
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(file.parent))
        return importlib.import_module(file.stem)
