"""All kernels of the package: listing them, finding those not compiled yet, and making them ready before use.

Compiling or loading a kernel inside a control loop delays it by seconds or milliseconds. Code that is about to run such
a loop should first make ready all kernels of the modules imported by then.
"""

from __future__ import annotations

import importlib
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, wait
from pathlib import Path
from typing import NamedTuple

from tactopose_drake.core.compilation import Kernel, Part, named_files

_CORE = Path(__file__).parent


def make_kernels_ready() -> None:
    """Compiles or loads all kernels of imported modules, except parts of others; later calls take no time."""
    for name in [name for name in sys.modules if name.startswith(__package__) and name.endswith("_kernels")]:
        for kernel in _kernels_of(name):
            if not isinstance(kernel, Part):
                kernel.make_ready()


def kernel_modules() -> dict[str, set[str]]:
    """The modules of kernels, each with those whose kernels may be compiled into its own."""
    paths = {path.stem: path for path in sorted(_CORE.rglob("*_kernels.py"))}
    return {
        _module(path): {_module(paths[other]) for other in named_files(path.read_bytes()) if other in paths}
        - {_module(path)}
        for path in paths.values()
    }


def missing_kernels() -> dict[str, list[str]]:
    """The names of the kernels that are not compiled yet, for this machine and version, by module."""
    missing = {}
    for module in kernel_modules():
        importlib.import_module(module)
        names = [kernel.py_func.__name__ for kernel in _kernels_of(module) if not kernel.is_kept()]
        if names:
            missing[module] = names
    return missing


class Compiled(NamedTuple):
    """A compiled module: its number of kernels, and how long that took, s."""

    module: str
    kernels: int
    duration: float


def compile_kernels(missing: dict[str, list[str]], submit: Callable[..., Future[Compiled]]) -> Iterator[Compiled]:
    """Compiles kernels in other processes, each module after those it depends on; yields each when done.

    Args:
        missing: from `missing_kernels`.
        submit: the method of an executor.
    """
    waiting = {module: _all_named(module) & missing.keys() for module in missing}
    running: dict[Future[Compiled], str] = {}
    while waiting or running:
        for module in [module for module, before in waiting.items() if not before]:
            del waiting[module]
            running[submit(compile_module, module, missing[module])] = module
        done, _ = wait(running, return_when=FIRST_COMPLETED)
        for future in done:
            module = running.pop(future)
            for before in waiting.values():
                before.discard(module)
            yield future.result()


def compile_module(module: str, names: list[str]) -> Compiled:
    """Compiles kernels of a module in this process."""
    started = time.perf_counter()
    content = vars(importlib.import_module(module))
    for name in names:
        content[name].make_ready()
    return Compiled(module, len(names), time.perf_counter() - started)


def _kernels_of(module: str) -> list[Kernel]:
    content = vars(sys.modules[module]).values()
    return [value for value in content if isinstance(value, Kernel) and value.py_func.__module__ == module]


def _all_named(module: str) -> set[str]:
    """The modules that a module depends on, directly or indirectly."""
    modules = kernel_modules()
    found, todo = set[str](), [module]
    while todo:
        new = modules[todo.pop()] - found
        found |= new
        todo += new
    return found - {module}


def _module(path: Path) -> str:
    return ".".join((str(__package__), *path.relative_to(_CORE).with_suffix("").parts))
