"""Compilation of inner loops with numba, each for the one signature that its annotations declare.

A function decorated with `@kernel` is compiled at its first call, for the types of its annotations and no others, and
cached on disk. So each kernel exists once. Arrays that it reads may be writable or read-only; all are C-contiguous.
Arguments of other types are rejected rather than compiled for. The arithmetic is IEEE's, in the order of the source: no
sums are reordered and no products fused, so equal arguments give equal bits, whatever was compiled before.

    @kernel
    def retract(X: Floats3, increment: Floats2, out: OutFloats3) -> None: ...

A function decorated with `@part` is a kernel that only other kernels call; it has no entry point for Python, which
takes long to compile for many arguments, and no machine code of its own. A function decorated with `@inlined` becomes
part of its callers, for whatever types they have. It is inlined by LLVM: numba's own inlining infers the types of each
copy anew, which takes a third longer.

Assigning an array to another's slice or row makes numba compile an error message about shapes, with all its string
operations, for seconds; `sorting_kernels.copy_vector` and `copy_matrix` avoid that.
"""

import contextlib
import functools
import gc
import hashlib
import inspect
import re
import typing
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numba.core import types
from numba.core.compiler_lock import global_compiler_lock
from numba.core.registry import CPUDispatcher

from tactopose_drake.core import kernel_types, linked_code
from tactopose_drake.core.kernel_cache import kernel_cache
from tactopose_drake.core.kernel_types import is_named_tuple, numba_type

Function = TypeVar("Function", bound=Callable[..., Any])


@contextlib.contextmanager
def _without_collections() -> Iterator[None]:
    """Disables garbage collection: numba's many allocations trigger it often, and hardly any are garbage yet."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()


class _Lean(CPUDispatcher):
    """A function that counts references to arrays only if it creates some, as each count is an atomic instruction.

    Callers hold references to its arguments meanwhile. It must not return an array that it has not created, or a view
    of one.
    """

    def compile(self, sig: Any) -> Any:
        """Called by numba: compiles the function for this signature."""
        counts = self.targetoptions["_nrt"] = _makes_arrays(self.py_func)
        entry = super().compile(sig)
        if not counts and any(_holds_arrays(signature.return_type) for signature in self.nopython_signatures):
            raise TypeError(f"{self.py_func} must return an array of its own, not one that it is given.")
        return entry


def _makes_arrays(function: Callable[..., Any]) -> bool:
    """Whether a function creates arrays, or calls one that does; without counts, numba rejects other ways to do so."""
    names, own = function.__code__.co_names, function.__globals__
    if {"empty", "zeros", "full"} & set(names):
        return True
    scopes = [own, *(vars(own[name]) for name in names if inspect.ismodule(own.get(name)))]
    called = [scope.get(name) for scope in scopes for name in names]
    return any(_makes_arrays(each.py_func) for each in called if isinstance(each, _Lean))


def _holds_arrays(returned: types.Type) -> bool:
    return isinstance(returned, types.Array) or any(map(_holds_arrays, getattr(returned, "types", ())))


class Kernel(_Lean):
    """A function that is compiled for the one signature that its annotations declare."""

    _can_compile: bool
    _cache: Any
    _insert: Callable[..., None]

    @functools.cached_property
    def declared(self) -> tuple[types.Type, ...]:
        """The types of the arguments."""
        hints = typing.get_type_hints(self.py_func, include_extras=True)
        return tuple(numba_type(hints[name]) for name in inspect.signature(self.py_func).parameters)

    @property
    def is_ready(self) -> bool:
        """Whether it is compiled or loaded."""
        return not self._can_compile

    def make_ready(self) -> None:
        """Compiles it, or loads it from the cache on disk; later calls do nothing. Threads wait for each other."""
        if self.is_ready:
            return
        with global_compiler_lock, _without_collections():
            if not self.is_ready:
                self.compile(self.declared)
                self.disable_compile()

    def is_kept(self) -> bool:
        """Whether its compiled code is in the cache on disk."""
        return bool(self._cache.holds(self.declared, self.targetctx))

    @functools.cached_property
    def _plain(self) -> list[Any]:
        """The types of the arguments when it is called from Python."""
        return [types.BaseTuple.from_types(t.types) if hasattr(t, "types") else t for t in self.declared]

    def add_overload(self, cres: Any) -> None:
        """Called by numba after compilation: registers the code for calls from Python and from other kernels."""
        self._insert([plain._code for plain in self._plain], cres.entry_point, cres.objectmode)
        self.overloads[self.declared] = cres

    def _search_new_conversions(self, *args: Any) -> bool:
        """Called by numba at the first call with arguments of other types, such as writable arrays."""
        given = [self.typeof_pyval(arg) for arg in args]
        return bool(self.typingctx.install_possible_conversions(given, self._plain))

    def _compile_for_args(self, *args: Any, **kws: Any) -> Any:
        """Called by numba at the first call: returns what to call with these arguments."""
        self.make_ready()
        return self

    def get_call_template(self, args: Any, kws: Any) -> Any:
        """Called by numba when another kernel calls this one."""
        self.make_ready()
        return super().get_call_template(args, kws)


class _OfTuples(Kernel):
    """A kernel with named tuples among its arguments.

    It is called with plain tuples, because numba would look up the names of a named tuple's fields at each call.
    """

    @functools.cached_property
    def _named(self) -> list[int]:
        """Indices of the arguments that are named tuples."""
        return [i for i, annotation in enumerate(_arguments(self.py_func)) if is_named_tuple(annotation)]

    def __call__(self, *args: Any) -> Any:
        """Calls it from Python."""
        plain = list(args)
        for i in self._named:
            plain[i] = tuple(plain[i])
        return CPUDispatcher.__call__(self, *plain)


def _arguments(function: Callable[..., Any]) -> list[Any]:
    """The annotations of a function's arguments."""
    return [annotation for name, annotation in function.__annotations__.items() if name != "return"]


class _WithoutEntry(_Lean):
    """A function without an entry point for Python: a call from Python, as in tests, compiles it once more with one."""

    @functools.cached_property
    def by_itself(self) -> CPUDispatcher:
        """The same function with an entry point."""
        return CPUDispatcher(py_func=self.py_func, targetoptions={"nopython": True, **_OPTIONS})

    def __call__(self, *args: Any) -> Any:
        """Calls it from Python."""
        return self.by_itself(*args)


class Part(_WithoutEntry, Kernel):
    """A kernel that only other kernels call."""


class Inlined(_WithoutEntry):
    """A function that becomes part of the kernels that call it."""


_OPTIONS = {"nogil": True, "error_model": "numpy", "no_cfunc_wrapper": True}


def kernel(function: Function) -> Function:
    """Compiles a function for the types of its annotations, at its first call."""
    told = {"nopython": True, **_OPTIONS}
    kind = _OfTuples if any(map(is_named_tuple, _arguments(function))) else Kernel
    compiled = kind(py_func=function, targetoptions=told, pipeline_class=linked_code.KernelCompiler)
    return typing.cast(Function, _cached(compiled))


def part(function: Function) -> Function:
    """Compiles a function that only other kernels call, for the types of its annotations."""
    return typing.cast(Function, _cached(_linked(Part, function)))


def inlined(function: Function) -> Function:
    """Makes a function part of the kernels that call it, for the types of their arguments."""
    return typing.cast(Function, _linked(Inlined, function, forceinline=True))


def _linked(kind: type[CPUDispatcher], function: Callable[..., Any], **options: bool) -> Any:
    """A dispatcher for a function that is linked into others, and has no code of its own."""
    told = {"nopython": True, **_OPTIONS, "no_cpython_wrapper": True, **options}
    return kind(py_func=function, targetoptions=told, pipeline_class=linked_code.LinkedCompiler)


def _cached(compiled: Kernel) -> Kernel:
    """Attaches the cache on disk to a kernel."""
    module = compiled.py_func.__module__.rsplit(".", 1)[-1]
    compiled._cache = kernel_cache(compiled.py_func, _fingerprint(module))
    return compiled


def read_only(array: Any) -> Any:
    """An array in the form of the fields of kernels' named tuples: contiguous and read-only."""
    if isinstance(array, np.ndarray) and not (flags := array.flags).writeable and flags.c_contiguous:
        return array
    contiguous = np.ascontiguousarray(array).view()
    contiguous.setflags(write=False)
    return contiguous


def named_files(source: bytes) -> list[str]:
    """The kernel files that a source refers to, without their endings."""
    return re.findall(r"\w+_kernels", source.decode())


@functools.cache
def _kernel_files() -> dict[str, Path]:
    """The package's kernel files, by name; names are unique."""
    return {path.stem: path for path in Path(__file__).parent.rglob("*_kernels.py")}


@functools.cache
def _fingerprint(name: str) -> bytes:
    """A hash of how kernels are compiled, and of the named kernel file with all kernel files that it refers to.

    Kernel files must not compile in anything else: a change of a constant in another file would not be noticed.
    """
    files, todo = _kernel_files(), [name]
    how = __file__, kernel_types.__file__, linked_code.__file__, str(Path(__file__).parent / "kernels" / "prefetch.py")
    found = {path: Path(path).read_bytes() for path in how}
    while todo:
        here = todo.pop()
        if here in files and here not in found:
            found[here] = files[here].read_bytes()
            todo += named_files(found[here])
    return hashlib.blake2b(b"".join(found[key] for key in sorted(found)), digest_size=16).digest()
