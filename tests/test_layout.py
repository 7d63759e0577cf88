"""Who may import whom, and what each folder offers: DESIGN of the rooms, held by their imports."""

import ast
import functools
import graphlib
import importlib
import json
import re
import sys
from collections import Counter, defaultdict
from collections.abc import Iterator
from pathlib import Path

import pytest
from pydrake.systems.framework import LeafSystem

import tactopose_drake

PACKAGE = Path(tactopose_drake.__file__).parent
ROOT = Path(__file__).parents[1]
FILES = {
    ".".join(("tactopose_drake", *path.relative_to(PACKAGE).with_suffix("").parts)).removesuffix(".__init__"): path
    for path in sorted(PACKAGE.rglob("*.py"))
}

# From the bottom; a folder may import those of lower floors, and the root's files are below them all.
FLOORS = [
    {"core"},
    {"estimation"},
    {"hand", "drivers", "visualization"},
    {"systems"},
    {"station"},
    {"runs"},
    {"cli"},
]


@functools.cache
def imports(module: str) -> set[str]:
    """Every module that one imports, at its top or anywhere inside, by full name."""
    return set(imported_names(ast.parse(FILES[module].read_text())))


def imported_names(tree: ast.AST) -> Iterator[str]:
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "imports are absolute"
            assert node.module is not None
            # `from a import b` may mean the module a.b.
            for alias in node.names:
                name = f"{node.module}.{alias.name}"
                yield name if name in FILES else node.module


def own_imports(module: str) -> set[str]:
    return {name for name in imports(module) if name in FILES}


def room(module: str) -> str:
    """The folder below the package that a module is in; its own name for the loose ones."""
    return module.split(".")[1] if "." in module else ""


def folder(module: str) -> str:
    return module if FILES[module].name == "__init__.py" else module.rsplit(".", 1)[0]


def in_room(name: str) -> list[str]:
    return [module for module in FILES if room(module) == name]


def test_the_root_holds_nothing_loose() -> None:
    entries = {path.name for path in PACKAGE.iterdir() if path.name not in ("__pycache__", "__init__.py")}
    rooms = {name for floor in FLOORS for name in floor}
    assert entries == {
        *rooms,
        "errors.py",
        "resources",
        "py.typed",
        "__init__.pyi",
    }


def test_the_rooms_are_there_without_an_import_of_their_own() -> None:
    rooms = {name.removesuffix(".py") for floor in FLOORS for name in floor} | {"errors", "resources"}
    folders = {path.name for path in (PACKAGE / "core").iterdir() if path.is_dir() and path.name != "__pycache__"}
    assert rooms == tactopose_drake._ROOMS
    assert folders == tactopose_drake.core._ROOMS
    for parent, names in ((tactopose_drake, rooms), (tactopose_drake.core, folders)):
        for name in names:
            assert getattr(parent, name).__name__ == f"{parent.__name__}.{name}"
        with pytest.raises(AttributeError, match=r"attribute '?attic"):
            _ = parent.attic


def test_no_file_name_occurs_twice() -> None:
    names = Counter(path.name for path in FILES.values())
    assert {name for name, count in names.items() if count > 1} == {"__init__.py"}


@pytest.mark.parametrize("floor", range(len(FLOORS)))
def test_imports_run_one_way(floor: int) -> None:
    below = {"errors", "resources"}.union(*FLOORS[:floor])
    for name in FLOORS[floor]:
        assert in_room(name)
        for module in in_room(name):
            assert {room(found) for found in own_imports(module)} <= {*below, name}, module


def test_no_two_folders_import_each_other() -> None:
    graph: dict[str, set[str]] = defaultdict(set)
    for module in FILES:
        if module != "tactopose_drake":
            graph[folder(module)] |= {folder(found) for found in own_imports(module)} - {folder(module)}
    # The root's files, and those of core itself, are below the folders beside them.
    del graph["tactopose_drake.core"]
    assert not graph["tactopose_drake"]
    graphlib.TopologicalSorter(graph).prepare()  # raises CycleError, which names the cycle


def test_modules_import_no_cycle() -> None:
    graph = {module: own_imports(module) - {module} for module in FILES}
    graphlib.TopologicalSorter(graph).prepare()


@pytest.mark.parametrize("module", in_room("core"))
def test_core_knows_neither_drake_nor_the_rest_of_the_package(module: str) -> None:
    foreign = {name.split(".")[0] for name in imports(module)} - sys.stdlib_module_names - {"tactopose_drake"}
    assert foreign <= {"numpy", "scipy", "numba", "llvmlite", "trimesh", "manifold3d", "platformdirs", "lazy_loader"}
    assert {room(found) for found in own_imports(module)} <= {"core", "errors"}


@pytest.mark.parametrize("module", in_room("drivers"))
def test_drivers_know_neither_drake_nor_the_systems(module: str) -> None:
    foreign = {name.split(".")[0] for name in imports(module)} - sys.stdlib_module_names - {"tactopose_drake"}
    assert foreign <= {"can", "lcm", "numpy", "lazy_loader"}
    allowed = {"tactopose_drake.core.validation", "tactopose_drake.errors"}
    assert {found for found in own_imports(module) if room(found) != "drivers"} <= allowed


def test_nothing_inside_imports_the_public_names() -> None:
    assert not [module for module in FILES if "tactopose_drake" in imports(module)]


FACES = [module for module, path in FILES.items() if path.with_suffix(".pyi").exists()]


@pytest.mark.parametrize("module", FACES)
def test_each_name_of_a_face_is_there(module: str) -> None:
    face = importlib.import_module(module)
    assert face.__all__
    for name in face.__all__:
        value = getattr(face, name)
        assert not isinstance(value, type(sys)), f"{module}.{name} is a module"
    for path in FILES[module].parent.glob("*.py"):
        assert path.stem not in face.__all__, f"the module {path} hides the name of its face"


def user_sources() -> Iterator[tuple[Path, str]]:
    """What a user reads and copies: README, guides, examples and notebooks."""
    for path in [*ROOT.glob("*.md"), *PACKAGE.rglob("*.md"), *ROOT.glob("docs/**/*.md"), *ROOT.glob("models/**/*.md")]:
        for block in re.findall(r"```python\n(.*?)```", path.read_text(), re.DOTALL):
            yield path, block
    for path in [*ROOT.glob("examples/**/*.py"), *ROOT.glob("models/**/*.py")]:
        yield path, path.read_text()
    for path in ROOT.glob("notebooks/*.ipynb"):
        cells = json.loads(path.read_text())["cells"]
        yield path, "\n".join("".join(cell["source"]) for cell in cells if cell["cell_type"] == "code")


def test_users_import_from_faces_alone() -> None:
    seen = 0
    for path, source in user_sources():
        for node in ast.walk(ast.parse(source)):
            if not isinstance(node, ast.ImportFrom) or not (node.module or "").startswith("tactopose_drake."):
                continue
            parts = str(node.module).split(".")
            assert len(parts) <= (3 if parts[1] == "core" else 2), f"{path}: {node.module} is inside a room"
            face = importlib.import_module(str(node.module))
            for alias in node.names:
                assert hasattr(face, alias.name), f"{path}: {node.module} has no {alias.name}"
                if node.module in FACES:
                    assert alias.name in face.__all__, f"{path}: {node.module} does not offer {alias.name}"
                seen += 1
    assert seen > 100


def test_every_system_is_offered_and_shown() -> None:
    face = importlib.import_module("tactopose_drake.systems")
    systems = {name for name in face.__all__ if name.startswith("Add")}
    for path in (PACKAGE / "systems").glob("*.py"):
        for node in ast.parse(path.read_text()).body:
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                module = importlib.import_module(f"tactopose_drake.systems.{path.stem}")
                if issubclass(getattr(module, node.name), LeafSystem):
                    systems.add(node.name)
    assert len(systems) > 25
    assert systems <= set(face.__all__)
    shown = "\n".join(source for _, source in user_sources())
    assert not [name for name in systems if not re.search(rf"\b{name}\b", shown)]
