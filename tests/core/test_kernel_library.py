"""Which kernels there are, and that each is compiled once, after those that become part of it."""

import graphlib
import importlib
import sys
from collections.abc import Callable
from concurrent.futures import Future
from pathlib import Path

import pytest

import tactopose_drake
from tactopose_drake.core import kernel_library
from tactopose_drake.core.compilation import Kernel, Part
from tactopose_drake.core.kernel_library import Compiled, compile_kernels, kernel_modules, make_kernels_ready

CORE = Path(tactopose_drake.__file__).parent / "core"


def test_all_modules_of_kernels_are_found_and_none_is_part_of_itself() -> None:
    modules = kernel_modules()
    assert {module.rsplit(".", 1)[-1] for module in modules} == {path.stem for path in CORE.rglob("*_kernels.py")}
    descend = modules["tactopose_drake.core.kernels.descent_kernels"]
    assert "tactopose_drake.core.kernels.least_squares_kernels" in descend
    graphlib.TopologicalSorter(modules).prepare()  # raises CycleError, which names the cycle


def test_a_module_is_compiled_when_those_that_it_names_are(monkeypatch: pytest.MonkeyPatch) -> None:
    parts = {"a": set[str](), "b": {"a"}, "c": {"b"}, "d": set[str](), "e": {"b", "d"}}
    monkeypatch.setattr(kernel_library, "kernel_modules", lambda: parts)
    done: list[str] = []

    def submit(work: Callable[..., Compiled], module: str, names: list[str]) -> Future[Compiled]:
        assert work is kernel_library.compile_module
        assert not (parts[module] & missing.keys()) - set(done)
        future: Future[Compiled] = Future()
        future.set_result(Compiled(module, len(names), 1.0))
        return future

    missing = {"c": ["f"], "a": ["f", "g"], "e": ["f"]}  # b is compiled already, and c waits for a all the same
    for compiled in compile_kernels(missing, submit):
        done.append(compiled.module)
        assert compiled.kernels == len(missing[compiled.module])
    assert sorted(done) == ["a", "c", "e"]
    assert done[0] == "a"


def test_what_is_not_compiled_is_told_and_compiled(monkeypatch: pytest.MonkeyPatch) -> None:
    module = "tactopose_drake.core.kernels.sorting_kernels"
    monkeypatch.setattr(kernel_library, "kernel_modules", lambda: {module: set()})
    content = vars(importlib.import_module(module))
    content["select"].make_ready()
    assert kernel_library.missing_kernels().get(module, []).count("select") == 0
    monkeypatch.setattr(Kernel, "is_kept", lambda kernel: kernel.py_func.__name__ != "select")
    assert kernel_library.missing_kernels() == {module: ["select"]}
    assert kernel_library.compile_module(module, ["select"])[:2] == (module, 1)


def test_all_kernels_of_imported_modules_are_made_ready() -> None:
    importlib.import_module("tactopose_drake.core.surfaces.surface_kernels")
    make_kernels_ready()
    names = [name for name in sys.modules if name.startswith("tactopose_drake.core.") and name.endswith("_kernels")]
    kernels = [value for name in names for value in vars(sys.modules[name]).values() if isinstance(value, Kernel)]
    assert kernels
    for kernel in kernels:
        assert kernel.is_ready or isinstance(kernel, Part), kernel.py_func.__name__
