"""Loads the shipped objects and the script that makes them, for the tests."""

import importlib.util
from types import ModuleType

import trimesh

from tactopose_drake.resources import model_path

FOLDER = model_path("objects")


def _load_generator() -> ModuleType:
    """The script is not part of the package; running it puts its own folder on the path."""
    spec = importlib.util.spec_from_file_location("generate_objects", FOLDER / "generate.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


generate = _load_generator()
CATALOGUE = generate.CATALOGUE


def shipped(name: str) -> trimesh.Trimesh:
    return trimesh.load_mesh(FOLDER / f"{name}.obj", process=False)
