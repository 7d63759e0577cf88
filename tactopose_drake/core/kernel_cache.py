"""The cache of compiled kernels on disk; failures of it are never errors.

Numba puts it into the first writable folder: `NUMBA_CACHE_DIR`, the package's own `__pycache__`, the user's cache
folder. If none is writable, as in a read-only installation whose user has no home, a folder among the temporary files
is used, and if that cannot be trusted, each process compiles the kernels anew. Either is logged in one line.

A cache of kernels contains code: whoever can write to its folder determines what is run. So the folder among the
temporary files is used only if it belongs to this user, and is accessible to nobody else.

Kernels shipped with a wheel take precedence over all of these, see `shipped_kernels`.
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
    """The cache of a function's compiled code, which is valid as long as its file and the fingerprint are unchanged."""
    try:
        return KernelCache(function, fingerprint)
    except RuntimeError:  # raised by numba if there is no folder
        _tell("there is no folder for compiled kernels, so each process compiles them anew, for a minute or more")
        return _NoCache()


class _TemporaryFolder(UserWideCacheLocator):
    """The user's own folder among the temporary files."""

    @classmethod
    def from_function(cls, py_func: Callable[..., Any], py_file: str) -> Any:
        """Called by numba: locates a function's code, or returns None."""
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
        """Restores compiled code from its cached form."""
        return load_result(target_context, payload)


class _NoCache(NullCache):
    """A cache that stores nothing."""

    def holds(self, sig: Any, target_context: Any) -> bool:
        """See `KernelCache.holds`."""
        return False


class KernelCache(FunctionCache):
    """Numba's cache of a function: damaged entries are compiled anew, and write errors are ignored."""

    _impl_class = _Places

    def __init__(self, function: Callable[..., Any], fingerprint: bytes) -> None:
        """Locates the folder.

        Args:
            function: whose code is cached.
            fingerprint: of all files that are compiled into it; numba itself only checks the function's own file.
        """
        super().__init__(function)
        self._cache_file._source_stamp = (self._cache_file._source_stamp, fingerprint)
        self._shipped = shipped_file(self._impl.filename_base, self._cache_file._source_stamp)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Loads the compiled code, or returns None.

        This needs only the run-time system of the compiler; the rest takes longer to load than all kernels together.
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
        except Exception:  # for a damaged file, pickle and LLVM raise almost anything
            with contextlib.suppress(OSError):
                self.flush()
            return None

    def holds(self, sig: Any, target_context: Any) -> bool:
        """Whether there is compiled code for this signature."""
        try:
            key = self._index_key(sig, target_context.codegen())
            shipped = run_here() and shipped_key(key) in self._shipped._load_index()
            return shipped or key in self._cache_file._load_index()
        except Exception:  # as above
            return False

    def save_overload(self, sig: Any, data: Any) -> None:
        """Stores compiled code."""
        with contextlib.suppress(OSError):
            super().save_overload(sig, data)


def own_folder() -> Path:
    """The folder among the temporary files, created if necessary.

    Raises:
        OSError: if it cannot be created, belongs to another user, or is accessible to others.
    """
    folder = Path(tempfile.gettempdir()) / f"tactopose_drake-{os.getuid()}"
    with contextlib.suppress(FileExistsError):
        folder.mkdir(mode=0o700)
    found = folder.lstat()
    if not stat.S_ISDIR(found.st_mode) or found.st_uid != os.getuid() or stat.S_IMODE(found.st_mode) & 0o077:
        raise PermissionError(f"{folder} is not this user's alone.")
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
    """Logs a message once."""
    logging.getLogger("tactopose_drake").warning("%s; NUMBA_CACHE_DIR names another folder", message)
