"""Safe writing of results: outputs are checked before the work, written to a temporary file, and then renamed."""

import contextlib
import os
import shutil
import threading
from collections.abc import Iterable, Iterator
from pathlib import Path

from tactopose_drake.errors import InvalidFileError
from tactopose_drake.estimation.input_files import files_behind

_LEAST_FREE = 5_000_000  # bytes; a page with a scene has 3 MB


def check_outputs(
    outputs: Iterable[Path | None], inputs: Iterable[Path | None] = (), renewed: Path | None = None
) -> None:
    """Checks, before any work, that output files can be written.

    Args:
        outputs: the files to be written; None entries are ignored.
        inputs: files and folders that are read. An output must neither be one of them nor in one of them, and the same
            goes for files that they name: the model of a hand, that model's meshes, and so on.
        renewed: a file that an input names but that is not read, so that an output may replace it.

    Raises:
        InvalidFileError: if an output's folder does not exist; if an output is a folder, an input, or another output;
            or if it cannot be written or its disk is full.
    """
    written: list[Path] = []
    wanted = [path for path in outputs if path is not None]
    read = [
        (path, _place(file))
        for path in inputs
        if path is not None
        for file in _behind(path, wanted)
        if file == path or renewed is None or _place(file) != _place(renewed)
    ]
    for path in wanted:
        place = _place(path)
        if not path.absolute().parent.is_dir():
            raise InvalidFileError(f"{path}: the folder {path.absolute().parent} does not exist.")
        if path.is_dir():
            raise InvalidFileError(f"{path} must be a file, which may be new, not a folder.")
        for given, other in read:
            if place == other or (other.is_dir() and place.is_relative_to(other)) or _is_same(place, other):
                way = "" if other == _place(given) else f", which {given} leads to"
                raise InvalidFileError(f"{path} must be another file than an input, and not in one{way}.")
        if any(place == other or _is_same(place, other) for other in written):
            raise InvalidFileError(f"{path} must be given for one output, not for two.")
        written.append(place)
        with written_beside(path) as beside:
            if beside != place:
                beside.touch()
                beside.unlink()
                free = shutil.disk_usage(beside.parent).free
                if free < _LEAST_FREE:
                    raise InvalidFileError(
                        f"{path}: its disk must have at least {_LEAST_FREE / 1e6:g} MB left, not {free / 1e6:.1f} MB."
                    )


@contextlib.contextmanager
def written_beside(path: Path) -> Iterator[Path]:
    """Yields a temporary file in the same folder, which replaces the file once the context ends without an error.

    Processes and threads that write the same file have one each. A device or pipe is written directly.

    Raises:
        InvalidFileError: if the file cannot be written; an existing one is then unchanged.
    """
    place = _place(path)
    try:
        if place.exists() and not place.is_file():
            yield place
            return
        beside = place.with_name(f".{os.getpid()}-{threading.get_ident()}-{place.name[-50:]}")
        try:
            yield beside
            if beside.exists():
                beside.replace(place)
        finally:
            beside.unlink(missing_ok=True)
    except OSError as error:
        raise InvalidFileError(f"{path} cannot be written ({error.strerror or error}).") from None


def _behind(path: Path, outputs: list[Path]) -> Iterable[Path]:
    """An input and, if anything is to be written, all files that it names directly or indirectly."""
    _place(path)
    return files_behind(path) if outputs else (path,)


def _place(path: Path) -> Path:
    """The absolute path with all symbolic links resolved, except to a pipe without a path of its own (`/dev/stdout`).

    Raises:
        InvalidFileError: if the path is too long or invalid, or its links lead in a circle.
    """
    try:
        place = path.resolve()
        if not place.exists() and path.exists():
            return path.absolute()
    except (OSError, RuntimeError, ValueError) as error:
        reason = "its links lead in a circle" if isinstance(error, RuntimeError) else "it is not a path"
        raise InvalidFileError(f"{path} cannot be used ({getattr(error, 'strerror', None) or reason}).") from None
    return place


def _is_same(first: Path, second: Path) -> bool:
    """Whether two paths are the same file, also by hard links."""
    try:
        return first.samefile(second)
    except OSError:
        return False
