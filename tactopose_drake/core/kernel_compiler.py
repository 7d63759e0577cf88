"""The compiler of kernels: numba's, without what no kernel needs, and with parts that are optimised where they end up.

Numba optimises each function by itself, makes machine code of it, and then does so again wherever it is called from. Of
a function that only other kernels call, the first is thrown away. So here such a function is lowered and no more; all
that a kernel calls is linked into it once, and optimised and translated there. The optimisations are numba's, and so
strict IEEE arithmetic stays as it is.

Code that numba compiles for others goes its own way, and its settings stay as they are.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from llvmlite import binding as llvm
from numba import _dynfunc
from numba.core import typed_passes, untyped_passes
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, CompileResult
from numba.core.compiler_machinery import PassManager, register_pass
from numba.core.environment import lookup_environment

_ENVIRONMENT = "_ZN08NumbaEnv"


class KernelLibrary(JITCodeLibrary):
    """The code of a kernel and all that it calls."""

    _linking_libraries: list[Any]
    _shared_module: Any

    def __init__(self, codegen: Any, name: str) -> None:
        super().__init__(codegen, name)
        self.enable_object_caching()
        self._bitcode: bytes | None = None

    def finalize(self) -> None:
        """Links, optimises and translates."""
        self._linking_libraries = _with_their_own(self._linking_libraries)
        super().finalize()
        for name in _environments(self._final_module):
            environment = lookup_environment(name)
            if environment is not None:
                self.codegen.set_env(name, environment)

    def _get_module_for_linking(self) -> Any:
        if self._shared_module is None and self._bitcode is not None:
            self._shared_module, self._bitcode = llvm.parse_bitcode(self._bitcode), None
        return super()._get_module_for_linking()

    def serialize(self) -> tuple[bytes, bytes]:
        """Its machine code, and for kernels that call it its bitcode."""
        _, _, data = self.serialize_using_object_code()
        return data

    @classmethod
    def restore(cls, codegen: Any, name: str, data: tuple[bytes, bytes], symbols: Iterable[str]) -> KernelLibrary:
        """From `serialize`; the bitcode is read when it is wanted."""
        self = cls(codegen, name)
        machine_code, self._bitcode = data
        self._set_compiled_object(machine_code)
        self._finalize_final_module()
        codegen._engine._defined_symbols.update(symbols)
        return self


class PartLibrary(JITCodeLibrary):
    """The code of a function that only kernels call, without what it calls."""

    def finalize(self) -> None:
        """Nothing: its callers do that."""
        self._finalize_dynamic_globals()
        self._finalized = True

    def serialize(self) -> bytes:
        """Its bitcode, with that of what it calls."""
        linked = self._final_module.clone()
        for library in _with_their_own(self._linking_libraries):
            linked.link_in(library._get_module_for_linking(), preserve=True)
        return bytes(linked.as_bitcode())

    @classmethod
    def restore(cls, codegen: Any, name: str, data: bytes, symbols: Iterable[str]) -> PartLibrary:
        """From `serialize`."""
        self = cls(codegen, name)
        self._final_module = llvm.parse_bitcode(data)
        self._finalized = True
        return self


def _with_their_own(libraries: Iterable[Any]) -> list[Any]:
    """Libraries, and those that parts among them call, each once."""
    found: dict[Any, None] = {}
    todo = list(libraries)[::-1]
    while todo:
        library = todo.pop()
        if library not in found:
            found[library] = None
            if isinstance(library, PartLibrary):
                todo += library._linking_libraries[::-1]
    return list(found)


def _environments(module: Any) -> list[str]:
    return [variable.name for variable in module.global_variables if variable.name.startswith(_ENVIRONMENT)]


class KernelCompiler(CompilerBase):
    """Compiles a kernel."""

    library_class: type = KernelLibrary
    lowering: type = typed_passes.NativeLowering

    def compile_extra(self, func: Any) -> CompileResult:
        """What numba asks for."""
        self.state.library = self.library_class(self.state.targetctx.codegen(), func.__qualname__)
        return super().compile_extra(func)

    def define_pipelines(self) -> list[PassManager]:
        """Of numba's passes those that kernels need; they have no closures, array expressions and the like."""
        passes = PassManager("kernel")
        for each in (
            untyped_passes.TranslateByteCode,
            untyped_passes.FixupArgs,
            untyped_passes.IRProcessing,
            untyped_passes.RewriteSemanticConstants,
            untyped_passes.GenericRewrites,
            untyped_passes.ReconstructSSA,
            typed_passes.NopythonTypeInference,
            typed_passes.PreLowerStripPhis,
            typed_passes.IRLegalization,
            typed_passes.AnnotateTypes,
            self.lowering,
            typed_passes.NoPythonBackend,
        ):
            passes.add_pass(each, each.__name__)
        passes.finalize()
        return [passes]


@register_pass(mutates_CFG=True, analysis_only=False)
class _PartLowering(typed_passes.NativeLowering):
    """Makes LLVM's code, and no machine code of it."""

    _name = "part_lowering"

    def run_pass(self, state: Any) -> bool:
        state.flags.no_compile = True
        super().run_pass(state)
        lowered = state["cr"]
        entry = entry_of_part(lowered.fndesc, lowered.env, state.library)
        state.targetctx.insert_user_function(entry, lowered.fndesc, [state.library])
        state["cr"] = lowered._replace(cfunc=entry)
        return True


class PartCompiler(KernelCompiler):
    """Compiles a function that only kernels call."""

    library_class = PartLibrary
    lowering = _PartLowering


def entry_of_part(description: Any, environment: Any, library: PartLibrary) -> Any:
    """By what numba knows a part: a function that is never called from Python."""
    name = description.qualname.split(".")[-1]
    return _dynfunc.make_function(description.lookup_module(), name, "", 0, environment, (library,))
