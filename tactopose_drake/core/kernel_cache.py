"""Where compiled kernels are kept between runs; no fault of it is an error.

Numba keeps them in the first folder that can be written: `NUMBA_CACHE_DIR`, the package's own `__pycache__`, the user's
cache folder. Where none can, as in a read-only installation whose user has no home, they go to a folder among the
temporary files, and where that cannot be trusted, each process compiles them anew. Either is told in one line.

A cache of kernels is code: who can write to its folder decides what is run. So the folder among the temporary files is
taken only if it belongs to this user, and nobody else may open it.

Before all of these comes what a wheel has brought, see `shipped_kernels`.
"""

import contextlib
import functools
import logging
import os
import stat
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from numba.core.caching import CompileResultCacheImpl, FunctionCache, NullCache, UserWideCacheLocator
from numba.core.runtime.nrt import rtsys

from tactopose_drake.core.linked_code import load_result
from tactopose_drake.core.shipped_kernels import are_there, run_here, shipped_file, shipped_key


def kernel_cache(function: Callable[..., Any], fingerprint: bytes) -> Any:
    """The cache of one function's compiled code, which is fresh while its file and the fingerprint are the same."""
    try:
        return KernelCache(function, fingerprint)
    except RuntimeError:  # numba's, where there is no folder
        _tell("there is no folder for compiled kernels, so each process compiles them anew, for a minute or more")
        return _NoCache()


class _TemporaryFolder(UserWideCacheLocator):
    """The user's own folder among the temporary files."""

    @classmethod
    def from_function(cls, py_func: Callable[..., Any], py_file: str) -> Any:
        """What numba asks for: the place of a function's code, or None."""
        try:
            folder = own_folder()
            self = cls(py_func, py_file)
            self._cache_path = str(folder / cls.get_suitable_cache_subpath(py_file))
            self.ensure_cache_path()
        except OSError:
            return None
        _tell(f"compiled kernels are kept in {folder}, for their usual places cannot be written")
        return self


class _Places(CompileResultCacheImpl):
    _locator_classes = [*CompileResultCacheImpl._locator_classes, _TemporaryFolder]  # noqa: RUF012 (as in the base class)

    def rebuild(self, target_context: Any, payload: Any) -> Any:
        """Compiled code from what is kept of it."""
        return load_result(target_context, payload)


class _NoCache(NullCache):
    """Keeps nothing."""

    def holds(self, sig: Any, target_context: Any) -> bool:
        """As `KernelCache.holds`."""
        return False


class KernelCache(FunctionCache):
    """Numba's cache of one function: what is damaged is compiled anew, what cannot be written is not kept."""

    _impl_class = _Places

    def __init__(self, function: Callable[..., Any], fingerprint: bytes) -> None:
        """Finds a folder.

        Args:
            function: whose code is kept.
            fingerprint: of all files that are compiled into it; numba itself looks at its own file alone.
        """
        super().__init__(function)
        self._cache_file._source_stamp = (self._cache_file._source_stamp, fingerprint)
        self._shipped = shipped_file(self._impl.filename_base, self._cache_file._source_stamp)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """The compiled code; None where there is none.

        Of the compiler it needs the run-time system alone. The rest takes longer to load than all kernels together.
        """
        try:
            rtsys.initialize(target_context)
            if run_here():
                data = self._shipped.load(shipped_key(self._index_key(sig, target_context.codegen())))
                if data is not None:
                    return self._impl.rebuild(target_context, data)
            found = self._load_overload(sig, target_context)
            if found is None and are_there():
                _tell_of_others()
            return found
        except Exception:  # a damaged file makes pickle and LLVM raise almost anything
            with contextlib.suppress(OSError):
                self.flush()
            return None

    def holds(self, sig: Any, target_context: Any) -> bool:
        """Whether there is compiled code of this signature."""
        try:
            key = self._index_key(sig, target_context.codegen())
            shipped = run_here() and shipped_key(key) in self._shipped._load_index()
            return shipped or key in self._cache_file._load_index()
        except Exception:  # as above
            return False

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keeps compiled code."""
        with contextlib.suppress(OSError):
            super().save_overload(sig, data)


def own_folder() -> Path:
    """The folder among the temporary files, which it makes if need be.

    Raises:
        OSError: if it cannot be made, is another user's, or others may open it.
    """
    folder = Path(tempfile.gettempdir()) / f"tactopose_drake-{os.getuid()}"
    with contextlib.suppress(FileExistsError):
        folder.mkdir(mode=0o700)
    found = folder.lstat()
    if not stat.S_ISDIR(found.st_mode) or found.st_uid != os.getuid() or stat.S_IMODE(found.st_mode) & 0o077:
        raise PermissionError(f"{folder}: is not this user's alone.")
    return folder


@functools.cache
def _tell_of_others() -> None:
    logging.getLogger("tactopose_drake").warning(
        "the compiled kernels that came with this package are for other versions of numba or Python, for other"
        " processors, or of other sources: kernels are compiled here instead, once, which takes a minute or more;"
        " `tactopose warm-up` does it beforehand"
    )


@functools.cache
def _tell(message: str) -> None:
    """Says something once."""
    logging.getLogger("tactopose_drake").warning("%s; NUMBA_CACHE_DIR names another folder", message)
