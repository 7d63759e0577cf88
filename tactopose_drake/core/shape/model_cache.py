"""A cache of arrays on disk, by content.

A file holds a set of arrays as a single numpy record without pickled objects, so that it is mapped into memory instead
of read: processes share it, and no file stays open. It is written to a temporary file and moved into place atomically,
so that readers and other writers never see a part of it. A checksum over key and content, stored in front, detects
damage and swapped files; a damaged file counts as missing. A folder that cannot be read or written is no error either:
the model is then built anew each time. Beyond a size limit the least recently used files are removed.
"""

from __future__ import annotations

import contextlib
import ctypes
import hashlib
import math
import mmap
import os
import tempfile
import warnings
import weakref
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import platformdirs
from numpy.typing import NDArray

from tactopose_drake.core.shape.checksum_kernels import checksum
from tactopose_drake.errors import InvalidFileError, InvalidInputError

FOLDER_VARIABLE = "TACTOPOSE_CACHE_DIR"
FORMAT_VERSION = 15
"""To be raised when the arrays' meaning, or what builds them, changes."""

LIMIT_VARIABLE = "TACTOPOSE_CACHE_GB"
DEFAULT_LIMIT = 2.0
"""The folder's size limit unless `TACTOPOSE_CACHE_GB` sets another, GB."""

_GB = 1e9
_ALIGNMENT = 64  # of each array in a file, bytes
_CHECK = "check"  # name of the checksum
_ENDINGS = (".npy", ".tmp")  # the latter for files being written, or left by a process that ended while writing

_LIBC = ctypes.CDLL(None, use_errno=True)
_LIBC.mmap.restype = ctypes.c_void_p
_LIBC.mmap.argtypes = (ctypes.c_void_p, ctypes.c_size_t, ctypes.c_int, ctypes.c_int, ctypes.c_int, ctypes.c_long)
_LIBC.munmap.argtypes = (ctypes.c_void_p, ctypes.c_size_t)
_MAP_FAILED = ctypes.c_void_p(-1).value

Arrays = dict[str, NDArray[Any]]


def cache_folder() -> Path:
    """Where the files are: `TACTOPOSE_CACHE_DIR` if that is set, otherwise the user's cache folder."""
    chosen = os.environ.get(FOLDER_VARIABLE)
    return Path(chosen).expanduser() if chosen else platformdirs.user_cache_path("tactopose_drake") / "models"


def cache_limit() -> float:
    """The folder's size limit, bytes: `TACTOPOSE_CACHE_GB` if that is set.

    Raises:
        InvalidInputError: if that is no number, or a negative one.
    """
    chosen = os.environ.get(LIMIT_VARIABLE)
    if not chosen:
        return DEFAULT_LIMIT * _GB
    try:
        limit = float(chosen)
    except ValueError:
        limit = math.nan
    if not limit >= 0.0:
        raise InvalidInputError(f"{LIMIT_VARIABLE} must be a number of gigabytes >= 0, not {chosen!r}.")
    return limit * _GB


class CachedFile(NamedTuple):
    """A file of the cache: when it was last used, s since 1970; its size, bytes; and its path."""

    used: float
    size: int
    path: Path


def cached_files() -> list[CachedFile]:
    """The cached files, the least recently used first; none if the folder cannot be read."""
    files = []
    with contextlib.suppress(OSError, RuntimeError), os.scandir(cache_folder()) as entries:
        for entry in entries:
            with contextlib.suppress(OSError):  # another process may have removed it
                if entry.name.endswith(_ENDINGS) and entry.is_file():
                    status = entry.stat()
                    files.append(CachedFile(status.st_mtime, status.st_size, Path(entry.path)))
    return sorted(files)


def clear() -> int:
    """Removes all cached files, and returns their size in bytes; models in memory are not affected.

    Raises:
        InvalidFileError: if a file cannot be removed.
    """
    files = cached_files()
    for file in files:
        try:
            file.path.unlink(missing_ok=True)
        except OSError as error:
            raise InvalidFileError(f"{file.path} cannot be removed ({error.strerror or error}).") from None
    return sum(file.size for file in files)


def content_key(*parts: bytes | NDArray[Any] | str) -> str:
    """The hash of the format version and the parts' contents, 32 hexadecimal digits."""
    digest = hashlib.blake2b(digest_size=16)
    for part in (f"format {FORMAT_VERSION}", *parts):
        content = part.encode() if isinstance(part, str) else part if isinstance(part, bytes) else part.tobytes()
        digest.update(len(content).to_bytes(8, "little"))
        digest.update(content)
    return digest.hexdigest()


def has(key: str) -> bool:
    """Whether a file exists for a key, possibly a damaged one."""
    try:
        return _path(key).exists()
    except (OSError, RuntimeError):
        return False


def load(key: str) -> Arrays | None:
    """The arrays stored under a key, read-only, mapped from the file; None if there is no valid file."""
    try:
        path = _path(key)
        record = _mapped(path)
        names = record.dtype.names or ()
        sound = record.shape == (1,) and names[0] == _CHECK and record[_CHECK][0].tobytes() == _digest(key, record)
    except Exception:  # for a damaged header, numpy's parser warns of and raises almost anything
        return None
    if not sound:
        return None
    with contextlib.suppress(OSError):
        os.utime(path)
    return {name: record[name][0, ...] for name in names[1:]}


def load_or_make(key: str, is_valid: Callable[[Arrays], bool], make: Callable[[], Arrays]) -> Arrays:
    """The arrays stored under a key if there are any and they are valid; otherwise those made, which are stored."""
    arrays = load(key)
    if arrays is None or not is_valid(arrays):
        arrays = make()
        store(key, arrays)
    return arrays


def store(key: str, arrays: Mapping[str, NDArray[Any]]) -> None:
    """Stores arrays of numbers under a key; does nothing if the folder cannot be written."""
    limit, record = cache_limit(), _record(key, arrays)
    if record.nbytes > limit:
        return
    temporary = None
    try:
        folder = cache_folder()
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=folder, prefix=key, suffix=".tmp", delete=False) as file:
            temporary = file.name
            np.save(file, record, allow_pickle=False)
        os.replace(temporary, _path(key))
        _remove_oldest(limit)
    except (OSError, RuntimeError):  # the latter if the folder is in the home of a user that does not exist
        if temporary is not None:
            with contextlib.suppress(OSError):
                Path(temporary).unlink(missing_ok=True)


def _path(key: str) -> Path:
    return cache_folder() / f"{key}.npy"


def _mapped(path: Path) -> NDArray[np.void]:
    """The record in a file, read-only, mapped until nothing views it.

    No descriptor stays open: the `mmap` of Python keeps one for each mapping, and often a process may have 1024 only.

    Raises:
        OSError, ValueError or others: if the file cannot be read, or does not have the format.
    """
    with path.open("rb") as file, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        np.lib.format.read_magic(file)
        shape, _, dtype = np.lib.format.read_array_header_1_0(file)
        start, size = file.tell(), os.fstat(file.fileno()).st_size
        address = _LIBC.mmap(None, size, mmap.PROT_READ, mmap.MAP_SHARED, file.fileno(), 0)
    if address in (None, _MAP_FAILED):
        raise OSError(ctypes.get_errno(), f"{path} cannot be mapped")
    content = (ctypes.c_char * size).from_address(address)
    weakref.finalize(content, _LIBC.munmap, address, size).atexit = False  # threads may still read it then
    return np.frombuffer(memoryview(content).toreadonly(), dtype, offset=start).reshape(shape)


def _record(key: str, arrays: Mapping[str, NDArray[Any]]) -> NDArray[np.void]:
    """Packs all arrays into one record, each aligned, the checksum first."""
    fields: dict[str, NDArray[Any]] = {_CHECK: np.zeros(8, dtype=np.uint8), **arrays}
    sizes = [-(-array.nbytes // _ALIGNMENT) * _ALIGNMENT for array in fields.values()]
    dtype = np.dtype(
        {
            "names": list(fields),
            "formats": [(array.dtype, array.shape) for array in fields.values()],
            "offsets": np.cumsum([0, *sizes[:-1]]).tolist(),
            "itemsize": sum(sizes),
        }
    )
    record = np.zeros(1, dtype=dtype)
    for name, array in arrays.items():
        record[name][0] = array
    record[_CHECK][0] = np.frombuffer(_digest(key, record), dtype=np.uint8)
    return record


def _digest(key: str, record: NDArray[np.void]) -> bytes:
    """The checksum of the key, the names and types of the arrays, and their content: 32 MB in about 3 ms.

    It detects damage, not malice: whoever can write to the folder can write valid files with wrong models.
    """
    head = hashlib.blake2b(f"format {FORMAT_VERSION} {key} {record.dtype!r}".encode(), digest_size=8).digest()
    words = record.view(np.uint64)[_ALIGNMENT // 8 :]
    return checksum(words, int.from_bytes(head, "little")).to_bytes(8, "little")


def _remove_oldest(limit: float) -> None:
    """Removes the least recently used files until the folder is within its size limit, bytes."""
    files = cached_files()
    total = sum(file.size for file in files)
    for file in files:
        if total <= limit:
            break
        file.path.unlink(missing_ok=True)
        total -= file.size
