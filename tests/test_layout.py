"""Who may import whom: core <- programs <- systems <- station <- command line; core <- drivers <- systems."""

import ast
import functools
import graphlib
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

import tactopose_drake

PACKAGE = Path(tactopose_drake.__file__).parent
FILES = {
    ".".join(("tactopose_drake", *path.relative_to(PACKAGE).with_suffix("").parts)).removesuffix(".__init__"): path
    for path in sorted(PACKAGE.rglob("*.py"))
}


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


def room(*names: str) -> list[str]:
    """The modules of these rooms, a package each or a module."""
    own = [f"tactopose_drake.{name}" for name in names]
    return [module for module in FILES if any(module == name or module.startswith(f"{name}.") for name in own)]


def own_imports(module: str) -> set[str]:
    return {name for name in imports(module) if name in FILES}


@functools.cache
def reached(module: str) -> set[str]:
    """Every module of the package that one imports, itself or through others."""
    found: set[str] = set()
    todo = [module]
    while todo:
        new = own_imports(todo.pop()) - found
        found |= new
        todo += new
    return found


def test_the_files_were_found() -> None:
    for name in ("core", "core.objectives.base", "drivers", "programs", "systems", "station", "cli", "errors"):
        assert f"tactopose_drake.{name}" in FILES
    assert "pydrake.systems.framework" in imports("tactopose_drake.systems.pose_estimator")


@pytest.mark.parametrize("module", room("core"))
def test_core_knows_neither_drake_nor_the_rest_of_the_package(module: str) -> None:
    foreign = {name.split(".")[0] for name in imports(module)} - sys.stdlib_module_names - {"tactopose_drake"}
    assert foreign <= {"numpy", "scipy", "numba", "llvmlite", "trimesh", "manifold3d", "platformdirs"}
    assert own_imports(module) <= {*room("core", "errors")}


@pytest.mark.parametrize("module", room("programs"))
def test_programs_know_only_core(module: str) -> None:
    assert own_imports(module) <= {*room("core", "programs", "errors")}


@pytest.mark.parametrize("module", room("drivers"))
def test_drivers_know_neither_drake_nor_the_systems(module: str) -> None:
    foreign = {name.split(".")[0] for name in imports(module)} - sys.stdlib_module_names - {"tactopose_drake"}
    assert foreign <= {"can", "numpy"}
    assert own_imports(module) <= {*room("core.validation", "drivers", "errors")}


@pytest.mark.parametrize("module", room("systems"))
def test_systems_know_nothing_that_is_built_from_them(module: str) -> None:
    systems = set(room("systems"))
    above = {module for module in FILES if module not in systems and reached(module) & systems}
    assert above >= {*room("station", "scenario", "cli")}
    assert not reached(module) & above


def test_only_the_command_line_knows_the_command_line() -> None:
    assert not [module for module in FILES if own_imports(module) & set(room("cli")) and module not in room("cli")]


def test_imports_run_one_way() -> None:
    graph = {module: own_imports(module) - {"tactopose_drake", module} for module in FILES}
    graphlib.TopologicalSorter(graph).prepare()  # raises CycleError, which names the cycle


def test_nothing_inside_imports_the_public_names() -> None:
    assert not [module for module in FILES if "tactopose_drake" in imports(module)]
