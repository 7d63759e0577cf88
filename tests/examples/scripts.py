"""Loads the scripts in examples/ as modules: those that a script imports from beside it are found."""

import importlib
from pathlib import Path
from types import ModuleType

import pytest

EXAMPLES = Path(__file__).parents[2] / "examples"


def load_script(path: str) -> ModuleType:
    """A script by its path from examples/, loaded anew."""
    file = EXAMPLES / path
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(file.parent))
        return importlib.reload(importlib.import_module(file.stem))
