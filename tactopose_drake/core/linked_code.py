"""A faster configuration of numba's compiler, without what kernels do not use.

For each function, numba looks for closures, branches on argument types, containers of mixed types and more that kernels
do not contain, and analyses it anew after each search. For each operator it tries all known overloads. It generates
machine code for every function it compiles, even for those that are only linked into others, where they are compiled
again; it optimises each function before they are linked, and then again; and from its cache it reads not only a
kernel's machine code but also the bitcode that others may link, which takes more time and memory. For processors with
vectors of 16 singles, it vectorises loops to that width, for which the kernels' many loops over eight are too short.
"""

import copy
import functools
from typing import Any

from llvmlite import binding as llvm
from numba.core import config, typed_passes, types, untyped_passes
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, DefaultPassBuilder, compile_result
from numba.core.compiler_machinery import PassManager
from numba.core.typing.context import Context

_TOLD: Any = config  # numba's user configuration; has no types
_FRONT = (
    untyped_passes.TranslateByteCode,
    untyped_passes.FixupArgs,
    untyped_passes.IRProcessing,
    untyped_passes.GenericRewrites,
    untyped_passes.RewriteDynamicRaises,
    untyped_passes.ReconstructSSA,
    typed_passes.NopythonTypeInference,
    typed_passes.PreLowerStripPhis,
    typed_passes.NopythonRewrites,
)


class KernelCompiler(CompilerBase):
    """Numba's compiler with only those passes that kernels need."""

    def __init__(self, typingctx: Any, targetctx: Any, *rest: Any) -> None:
        super().__init__(_remembering(typingctx), targetctx, *rest)
        self.state.library = self._library(targetctx.codegen())

    def _library(self, codegen: Any) -> JITCodeLibrary:
        library = _KernelLibrary(_for_256_bits(codegen), "kernel")
        library.enable_object_caching()
        return library

    def define_pipelines(self) -> list[PassManager]:
        """Called by numba: the passes in their order."""
        passes = PassManager("kernel")
        for each in _FRONT:
            passes.add_pass(each, each.__name__)
        passes.passes.extend(DefaultPassBuilder.define_nopython_lowering_pipeline(self.state).passes)
        passes.finalize()
        return [passes]


class _RememberingContext(Context):
    """Numba's typing context, which caches the result types of operators."""

    _known: dict[Any, Any]

    def resolve_function_type(self, func: Any, args: Any, kws: Any) -> Any:
        """Called by numba: the signature, or None."""
        if kws or isinstance(func, types.Dispatcher) or not all(isinstance(arg, types.Type) for arg in args):
            return super().resolve_function_type(func, args, kws)
        key = func, *args
        if key not in self._known:
            self._known[key] = super().resolve_function_type(func, args, kws)
        return self._known[key]


@functools.cache
def _remembering(context: Any) -> _RememberingContext:
    """A caching copy of numba's own context that shares its data."""
    remembering = copy.copy(context)
    remembering.__class__, remembering._known = _RememberingContext, {}
    return remembering


@functools.cache
def _for_256_bits(codegen: Any) -> Any:
    """Numba's code generator, with the same engine, limited to vectors of 256 bits."""
    options: dict[str, Any] = {"opt": _TOLD.OPT}
    codegen._customize_tm_options(options)
    if "+avx512f" not in options["features"]:
        return codegen
    options["features"] += ",+prefer-256-bit"
    narrow = copy.copy(codegen)
    narrow._tm = llvm.Target.from_triple(llvm.get_process_triple()).create_target_machine(**options)
    return narrow


class LinkedCompiler(KernelCompiler):
    """Numba's compiler for code that is only linked into other code."""

    def _library(self, codegen: Any) -> JITCodeLibrary:
        return LinkedLibrary(codegen, "linked")


class _KernelLibrary(JITCodeLibrary):
    """The code of a kernel, including all that is linked into it."""

    def _optimize_functions(self, ll_module: Any) -> None:
        """Does nothing: linked code is already optimised, and the whole is optimised as one module."""
        ll_module.data_layout = self._codegen._data_layout


class LinkedLibrary(JITCodeLibrary):
    """Code without machine code or address of its own."""

    @property
    def codegen(self) -> Any:
        """The target to which numba registers a function's environment; here it is ignored."""
        return _NoEngine

    def _optimize_final_module(self) -> None:
        """Does nothing: the code is optimised where it is linked, together with its callers."""

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._verify_declare_only_symbols()
        self._finalized = True

    def get_pointer_to_function(self, name: str) -> int:
        """There is none."""
        return 0

    def serialize_using_object_code(self) -> tuple[str, str, bytes]:
        """Called for the cache: there is no object code, only bitcode."""
        return self.name, "linked", self._get_module_for_linking().as_bitcode()


class _NoEngine:
    @staticmethod
    def set_env(env_name: str, env: Any) -> None:
        """Does nothing."""


class _LoadedLibrary(JITCodeLibrary):
    """Machine code from the cache, and bitcode for others to link, which is parsed on demand."""

    _bitcode: bytes

    def _get_module_for_linking(self) -> Any:
        if self._shared_module is None:
            self._shared_module = llvm.parse_bitcode(self._bitcode)
        return self._shared_module


def load_result(target_context: Any, payload: Any) -> Any:
    """Inverts numba's `CompileResult._reduce`; the same as its `_rebuild`, except for the libraries."""
    (name, kind, data), fndesc, env, signature, _, _, annotation, reload_init, environments = payload
    for initialise in reload_init:
        initialise()
    codegen = target_context.codegen()
    if kind == "linked":
        library: Any = LinkedLibrary(codegen, name)
        library._final_module = library._shared_module = llvm.parse_bitcode(data)
        library._finalized = True
    else:
        library = _LoadedLibrary(codegen, name)
        object_code, library._bitcode = data
        library.enable_object_caching()
        library._set_compiled_object(object_code)
        library._finalize_final_module()
        codegen._engine._defined_symbols.add(fndesc.llvm_cpython_wrapper_name)
    entry = target_context.get_executable(library, fndesc, env)
    for environment in environments:
        library.codegen.set_env(environment.env_name, environment)
    return compile_result(
        target_context=target_context,
        typing_context=target_context.typing_context,
        library=library,
        environment=env,
        entry_point=entry,
        fndesc=fndesc,
        type_annotation=annotation,
        signature=signature,
        objectmode=False,
        lifted=(),
        reload_init=reload_init,
        referenced_envs=environments,
    )
