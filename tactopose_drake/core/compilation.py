"""How inner loops are compiled: by numba, each for one signature, which its annotations say.

A function under `@kernel` is compiled when it is first called, for the types of its annotations and for no others, and
cached on disk. So each kernel exists once. Arrays that it reads may be writable or read-only; all are contiguous in C's
order. What does not fit is refused rather than compiled anew. The arithmetic is IEEE's, in the order of the source: no
sums are reordered and no products fused, so equal arguments give equal bits, whatever was compiled before.

    @kernel
    def retract(X: Floats3, increment: Floats2, out: OutFloats3) -> None: ...

One under `@part` is a kernel that only other kernels call; it has no entry for Python, which takes long to compile for
many arguments, and no machine code but theirs. A function under `@inlined` becomes part of its callers, for whatever
types they have. It is LLVM that puts it there: where numba does, it infers the types of each copy anew, which takes a
third as long again.

Where one array is assigned to another's slice or row, numba compiles what it says of shapes that differ, strings and
all, for seconds; `sorting_kernels.copy_vector` and `copy_matrix` say nothing.
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
    """Python looks for no garbage meanwhile: what numba makes of a kernel sets it off often, and is hardly any yet."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()


class _Lean(CPUDispatcher):
    """A function that counts references to arrays only where it makes some: each count is an atomic instruction.

    Whoever calls it holds its arguments meanwhile. What it has not made it must not return, nor a part of that.
    """

    def compile(self, sig: Any) -> Any:
        """What numba asks for: code for this signature."""
        counts = self.targetoptions["_nrt"] = _makes_arrays(self.py_func)
        entry = super().compile(sig)
        if not counts and any(_holds_arrays(signature.return_type) for signature in self.nopython_signatures):
            raise TypeError(f"{self.py_func}: returns an array that is not its own.")
        return entry


def _makes_arrays(function: Callable[..., Any]) -> bool:
    """Whether a function makes arrays, or calls one that does; other ways to make one numba refuses without counts."""
    names, own = function.__code__.co_names, function.__globals__
    if {"empty", "zeros", "full"} & set(names):
        return True
    scopes = [own, *(vars(own[name]) for name in names if inspect.ismodule(own.get(name)))]
    called = [scope.get(name) for scope in scopes for name in names]
    return any(_makes_arrays(each.py_func) for each in called if isinstance(each, _Lean))


def _holds_arrays(returned: types.Type) -> bool:
    return isinstance(returned, types.Array) or any(map(_holds_arrays, getattr(returned, "types", ())))


class Kernel(_Lean):
    """A function that is compiled for the one signature that its annotations say."""

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
        """What numba asks for once it is compiled, for calls from Python and from other kernels."""
        self._insert([plain._code for plain in self._plain], cres.entry_point, cres.objectmode)
        self.overloads[self.declared] = cres

    def _search_new_conversions(self, *args: Any) -> bool:
        """What numba asks for at the first call with arguments of other types, as of arrays that may be written."""
        given = [self.typeof_pyval(arg) for arg in args]
        return bool(self.typingctx.install_possible_conversions(given, self._plain))

    def _compile_for_args(self, *args: Any, **kws: Any) -> Any:
        """What numba asks for at the first call: what to call with these arguments."""
        self.make_ready()
        return self

    def get_call_template(self, args: Any, kws: Any) -> Any:
        """What numba asks for when another kernel calls this one."""
        self.make_ready()
        return super().get_call_template(args, kws)


class _OfTuples(Kernel):
    """A kernel that takes named tuples.

    It is called with plain ones, for numba spells the names of a named one's fields at each call.
    """

    @functools.cached_property
    def _named(self) -> list[int]:
        """Which arguments they are."""
        return [i for i, annotation in enumerate(_arguments(self.py_func)) if is_named_tuple(annotation)]

    def __call__(self, *args: Any) -> Any:
        """Calls it from Python."""
        plain = list(args)
        for i in self._named:
            plain[i] = tuple(plain[i])
        return CPUDispatcher.__call__(self, *plain)


def _arguments(function: Callable[..., Any]) -> list[Any]:
    """Their annotations."""
    return [annotation for name, annotation in function.__annotations__.items() if name != "return"]


class _WithoutEntry(_Lean):
    """What has no entry for Python: called from there, as tests do, it is compiled once more, with one."""

    @functools.cached_property
    def by_itself(self) -> CPUDispatcher:
        """The same with an entry."""
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
    """Likewise, a function that only other kernels call."""
    return typing.cast(Function, _cached(_linked(Part, function)))


def inlined(function: Function) -> Function:
    """Makes a function part of the kernels that call it, for the types that they give it."""
    return typing.cast(Function, _linked(Inlined, function, forceinline=True))


def _linked(kind: type[CPUDispatcher], function: Callable[..., Any], **options: bool) -> Any:
    """A function that becomes part of others, and nothing by itself."""
    told = {"nopython": True, **_OPTIONS, "no_cpython_wrapper": True, **options}
    return kind(py_func=function, targetoptions=told, pipeline_class=linked_code.LinkedCompiler)


def _cached(compiled: Kernel) -> Kernel:
    """With its cache on disk."""
    module = compiled.py_func.__module__.rsplit(".", 1)[-1]
    compiled._cache = kernel_cache(compiled.py_func, _fingerprint(module))
    return compiled


def read_only(array: Any) -> Any:
    """An array as the fields of kernels' named tuples are: contiguous and read-only."""
    if isinstance(array, np.ndarray) and not (flags := array.flags).writeable and flags.c_contiguous:
        return array
    contiguous = np.ascontiguousarray(array).view()
    contiguous.setflags(write=False)
    return contiguous


def named_files(source: bytes) -> list[str]:
    """The files of kernels that a source names, without their endings."""
    return re.findall(r"\w+_kernels", source.decode())


@functools.cache
def _kernel_files() -> dict[str, Path]:
    """The package's files of kernels, by name; none occurs twice."""
    return {path.stem: path for path in Path(__file__).parent.rglob("*_kernels.py")}


@functools.cache
def _fingerprint(name: str) -> bytes:
    """Of how kernels are compiled, and the file of that name with all that it names and so may have compiled in it.

    Files of kernels take nothing else that is compiled in: a constant of another file would go unnoticed.
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
