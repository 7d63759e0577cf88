"""Arrays kept on disk between runs, by content.

One file holds one set of arrays as a single numpy record without pickled objects, so that it is mapped into memory
instead of read. It is written beside its place and moved there in one step, so readers and other writers never see
half of it. A hash over the key and the content, stored in front, shows damage, and files that changed places; a damaged
file is as good as a missing one. A folder that cannot be read or written to is no error either: the model is then built
anew each time.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import tempfile
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import platformdirs
from numpy.typing import NDArray

FOLDER_VARIABLE = "TACTOPOSE_CACHE_DIR"
FORMAT_VERSION = 6
"""To be raised when the arrays' meaning, or what builds them, changes."""

LARGEST_FOLDER = 4 * 2**30
"""The least recently used files are removed beyond this size, bytes."""

_ALIGNMENT = 64  # of each array in a file, bytes
_CHECK = "check"  # the name of the hash

Arrays = dict[str, NDArray[Any]]


def cache_folder() -> Path:
    """Where the files are: `TACTOPOSE_CACHE_DIR` if that is set, otherwise the user's cache folder."""
    chosen = os.environ.get(FOLDER_VARIABLE)
    return Path(chosen).expanduser() if chosen else platformdirs.user_cache_path("tactopose_drake") / "models"


def content_key(*parts: bytes | NDArray[Any] | str) -> str:
    """The hash of the format version and the parts' contents, 32 hexadecimal digits."""
    digest = hashlib.blake2b(digest_size=16)
    for part in (f"format {FORMAT_VERSION}", *parts):
        content = part.encode() if isinstance(part, str) else part if isinstance(part, bytes) else part.tobytes()
        digest.update(len(content).to_bytes(8, "little"))
        digest.update(content)
    return digest.hexdigest()


def load(key: str) -> Arrays | None:
    """The arrays stored under a key, read-only, mapped from the file; None if there are none, or damaged ones."""
    try:
        path = _path(key)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            record = np.load(path, mmap_mode="r", allow_pickle=False)
        names = record.dtype.names
        sound = record.shape == (1,) and names[0] == _CHECK and record[_CHECK][0].tobytes() == _digest(key, record)
    except Exception:  # a damaged header makes numpy's parser warn of and raise almost anything
        return None
    if not sound:
        return None
    with contextlib.suppress(OSError):
        os.utime(path)
    return {name: record[name][0, ...].view(np.ndarray) for name in names[1:]}


def store(key: str, arrays: Mapping[str, NDArray[Any]]) -> None:
    """Keeps arrays of numbers under a key; does nothing where the folder cannot be written to."""
    record = _record(key, arrays)
    temporary = None
    try:
        folder = cache_folder()
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=folder, prefix=key, suffix=".tmp", delete=False) as file:
            temporary = file.name
            np.save(file, record, allow_pickle=False)
        os.replace(temporary, _path(key))
        _remove_oldest(folder)
    except (OSError, RuntimeError):  # the latter where the folder is in the home of somebody who does not exist
        if temporary is not None:
            with contextlib.suppress(OSError):
                Path(temporary).unlink(missing_ok=True)


def _path(key: str) -> Path:
    return cache_folder() / f"{key}.npy"


def _record(key: str, arrays: Mapping[str, NDArray[Any]]) -> NDArray[np.void]:
    """One record of all arrays, each aligned, the hash first."""
    fields: dict[str, NDArray[Any]] = {_CHECK: np.zeros(32, dtype=np.uint8), **arrays}
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
    """The hash of the key, the names and types of the arrays, and their content.

    SHA-256 because processors compute it: 32 MB in 20 ms, a third of what BLAKE2b takes.
    """
    digest = hashlib.sha256(f"format {FORMAT_VERSION} {key} {record.dtype!r}".encode())
    digest.update(record.view(np.ndarray).view(np.uint8)[_ALIGNMENT:].data)
    return digest.digest()


def _remove_oldest(folder: Path) -> None:
    """Removes the least recently used files until the folder is within its bound."""
    files = []
    for path in folder.glob("*.npy"):
        with contextlib.suppress(OSError):  # another process may have removed it
            status = path.stat()
            files.append((status.st_mtime, status.st_size, path))
    total = sum(size for _, size, _ in files)
    for _, size, path in sorted(files)[:-1]:
        if total <= LARGEST_FOLDER:
            break
        path.unlink(missing_ok=True)
        total -= size
