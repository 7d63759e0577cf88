"""Loads the scripts in examples/ as modules: those that a script imports from beside it are found."""

import importlib
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType

import pytest

EXAMPLES = Path(__file__).parents[2] / "examples"


def load_script(path: str) -> ModuleType:
    """A script by its path from examples/, loaded anew."""
    known = sys.modules.get((EXAMPLES / path).stem)
    with _beside(path) as name:
        return importlib.import_module(name) if known is None else importlib.reload(known)


def share_script(path: str) -> ModuleType:
    """The same module that other scripts import."""
    with _beside(path) as name:
        return importlib.import_module(name)


@contextmanager
def _beside(path: str) -> Iterator[str]:
    """Where a script's folder is searched for modules: its name there."""
    file = EXAMPLES / path
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(file.parent))
        yield file.stem
