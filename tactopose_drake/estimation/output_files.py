"""Writing results so that nothing is destroyed: checked before the work, written beside, and only then renamed."""

import contextlib
import os
import shutil
from collections.abc import Iterable, Iterator
from pathlib import Path

from tactopose_drake.errors import InvalidFileError
from tactopose_drake.estimation.input_files import files_behind

_LEAST_FREE = 5_000_000  # bytes; a page with a scene has 3 MB


def check_outputs(
    outputs: Iterable[Path | None], inputs: Iterable[Path | None] = (), renewed: Path | None = None
) -> None:
    """Tells, before any work, whether files can be written there.

    Args:
        outputs: the files that are to be written; None stands for none.
        inputs: files and folders that are read; an output may neither be one nor be in one, nor in those that these
            name: the model of a hand, that model's meshes, and so on.
        renewed: a file that an input names and that an output may be all the same, since it is not read.

    Raises:
        InvalidFileError: if a folder does not exist, an output is a folder, an input, or another output, or nothing can
            be written there, for want of room too.
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
            raise InvalidFileError(f"{path}: is a folder; allowed is a file, which may be new.")
        for given, other in read:
            if place == other or (other.is_dir() and place.is_relative_to(other)) or _is_same(place, other):
                way = "" if other == _place(given) else f", which {given} leads to"
                raise InvalidFileError(f"{path}: is an input, or in one{way}; allowed is another file.")
        if any(place == other or _is_same(place, other) for other in written):
            raise InvalidFileError(f"{path}: is to be written twice; allowed is a file for each output.")
        written.append(place)
        with written_beside(path) as beside:
            if beside != place:
                beside.touch()
                beside.unlink()
                free = shutil.disk_usage(beside.parent).free
                if free < _LEAST_FREE:
                    raise InvalidFileError(
                        f"{path}: its disk has {free / 1e6:.1f} MB left; allowed are {_LEAST_FREE / 1e6:g} and more."
                    )


@contextlib.contextmanager
def written_beside(path: Path) -> Iterator[Path]:
    """A file to write in place of another, which it replaces when all is written; until then, that one stays.

    What is no file but a device or a pipe is written itself.

    Raises:
        InvalidFileError: if it cannot be written; what was there before is there still.
    """
    place = _place(path)
    try:
        if place.exists() and not place.is_file():
            yield place
            return
        beside = place.with_name(f".{os.getpid()}-{place.name[-100:]}")
        try:
            yield beside
            if beside.exists():
                beside.replace(place)
        finally:
            beside.unlink(missing_ok=True)
    except OSError as error:
        raise InvalidFileError(f"{path}: cannot be written ({error.strerror or error}).") from None


def _behind(path: Path, outputs: list[Path]) -> Iterable[Path]:
    """An input and, if something is to be written, what it leads to."""
    _place(path)
    return files_behind(path) if outputs else (path,)


def _place(path: Path) -> Path:
    """Where a path leads.

    Raises:
        InvalidFileError: if that is nowhere: it is too long, no path, or its links lead in a circle.
    """
    try:
        place = path.resolve()
        place.exists()
    except (OSError, RuntimeError, ValueError) as error:
        reason = "its links lead in a circle" if isinstance(error, RuntimeError) else "it is no path"
        raise InvalidFileError(f"{path}: cannot be used ({getattr(error, 'strerror', None) or reason}).") from None
    return place


def _is_same(first: Path, second: Path) -> bool:
    """Whether two paths lead to one file, by hard links too."""
    try:
        return first.samefile(second)
    except OSError:
        return False
