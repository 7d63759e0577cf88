"""Compiled code as the package makes and keeps it: without what nobody is going to use.

Numba looks, in each function, for closures, branches on the types of arguments, containers of mixed types and more that
kernels have none of, and analyses it anew after each search. At each place where an operator stands it asks all that it
knows of the operator. It makes machine code of each function that it compiles, also of those that are only linked into
others, where they are compiled once more; it optimises each function before all are put together, and then again; and
it reads, beside the machine code of a kernel from its cache, what others may link, which takes longer and more memory.
Where a processor has instructions for 16 singles, it makes loops of these, to which the kernels' many loops over eight
are too short.
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

_TOLD: Any = config  # by numba's user; has no types
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
    """Numba's compiler, of whose passes over a function only those are run that kernels need."""

    def __init__(self, typingctx: Any, targetctx: Any, *rest: Any) -> None:
        super().__init__(_remembering(typingctx), targetctx, *rest)
        self.state.library = self._library(targetctx.codegen())

    def _library(self, codegen: Any) -> JITCodeLibrary:
        library = _KernelLibrary(_for_256_bits(codegen), "kernel")
        library.enable_object_caching()
        return library

    def define_pipelines(self) -> list[PassManager]:
        """What numba asks for: the passes, in their order."""
        passes = PassManager("kernel")
        for each in _FRONT:
            passes.add_pass(each, each.__name__)
        passes.passes.extend(DefaultPassBuilder.define_nopython_lowering_pipeline(self.state).passes)
        passes.finalize()
        return [passes]


class _RememberingContext(Context):
    """Numba's knowledge of types, which remembers what an operator gives for arguments of some types."""

    _known: dict[Any, Any]

    def resolve_function_type(self, func: Any, args: Any, kws: Any) -> Any:
        """What numba asks for: the signature, or None."""
        if kws or isinstance(func, types.Dispatcher) or not all(isinstance(arg, types.Type) for arg in args):
            return super().resolve_function_type(func, args, kws)
        key = func, *args
        if key not in self._known:
            self._known[key] = super().resolve_function_type(func, args, kws)
        return self._known[key]


@functools.cache
def _remembering(context: Any) -> _RememberingContext:
    """The same knowledge, shared with numba's own context."""
    remembering = copy.copy(context)
    remembering.__class__, remembering._known = _RememberingContext, {}
    return remembering


@functools.cache
def _for_256_bits(codegen: Any) -> Any:
    """Numba's maker of machine code, with the same engine, whose loops take 256 bits to an instruction at the most."""
    options: dict[str, Any] = {"opt": _TOLD.OPT}
    codegen._customize_tm_options(options)
    if "+avx512f" not in options["features"]:
        return codegen
    options["features"] += ",+prefer-256-bit"
    narrow = copy.copy(codegen)
    narrow._tm = llvm.Target.from_triple(llvm.get_process_triple()).create_target_machine(**options)
    return narrow


class LinkedCompiler(KernelCompiler):
    """Numba's compiler, for code that is only linked into other code."""

    def _library(self, codegen: Any) -> JITCodeLibrary:
        return LinkedLibrary(codegen, "linked")


class _KernelLibrary(JITCodeLibrary):
    """Code of a kernel, with all that is linked into it."""

    def _optimize_functions(self, ll_module: Any) -> None:
        """Where all of it is in one module it is optimised; what is linked has been before."""
        ll_module.data_layout = self._codegen._data_layout


class LinkedLibrary(JITCodeLibrary):
    """Code that is not made machine code of by itself, and has no address."""

    @property
    def codegen(self) -> Any:
        """Where numba tells a function's environment; there is nobody to be told."""
        return _NoEngine

    def _optimize_final_module(self) -> None:
        """Where it is linked it is optimised, together with its callers."""

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._verify_declare_only_symbols()
        self._finalized = True

    def get_pointer_to_function(self, name: str) -> int:
        """None."""
        return 0

    def serialize_using_object_code(self) -> tuple[str, str, bytes]:
        """For the cache: there is no object code."""
        return self.name, "linked", self._get_module_for_linking().as_bitcode()


class _NoEngine:
    @staticmethod
    def set_env(env_name: str, env: Any) -> None:
        """Nothing."""


class _LoadedLibrary(JITCodeLibrary):
    """Machine code from the cache, and what others may link, which is read when they do."""

    _bitcode: bytes

    def _get_module_for_linking(self) -> Any:
        if self._shared_module is None:
            self._shared_module = llvm.parse_bitcode(self._bitcode)
        return self._shared_module


def load_result(target_context: Any, payload: Any) -> Any:
    """What numba's `CompileResult._reduce` has made plain data of, as its `_rebuild` does it but for the libraries."""
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
