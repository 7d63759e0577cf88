"""Writing results so that nothing is destroyed: checked before the work, written beside, and only then renamed."""

import contextlib
import os
from collections.abc import Iterable, Iterator
from pathlib import Path

from tactopose_drake.errors import InvalidFileError


def check_outputs(outputs: Iterable[Path | None], inputs: Iterable[Path | None] = ()) -> None:
    """Tells, before any work, whether files can be written there.

    Args:
        outputs: the files that are to be written; None stands for none.
        inputs: files and folders that are read; an output may neither be one nor be in one.

    Raises:
        InvalidFileError: if a folder does not exist, an output is a folder, an input, or another output, or nothing can
            be written there.
    """
    written: list[Path] = []
    for path in (path for path in outputs if path is not None):
        if not path.absolute().parent.is_dir():
            raise InvalidFileError(f"{path}: the folder {path.absolute().parent} does not exist.")
        if path.is_dir():
            raise InvalidFileError(f"{path}: is a folder; allowed is a file, which may be new.")
        place = path.resolve()
        for other in (other.resolve() for other in inputs if other is not None):
            if place == other or (other.is_dir() and place.is_relative_to(other)) or _is_same(place, other):
                raise InvalidFileError(f"{path}: is an input, or in one; allowed is another file.")
        if any(place == other or _is_same(place, other) for other in written):
            raise InvalidFileError(f"{path}: is to be written twice; allowed is a file for each output.")
        written.append(place)
        with written_beside(path) as beside:
            if beside != place:
                beside.touch()
                beside.unlink()


@contextlib.contextmanager
def written_beside(path: Path) -> Iterator[Path]:
    """A file to write in place of another, which it replaces when all is written; until then, that one stays.

    What is no file but a device or a pipe is written itself.

    Raises:
        InvalidFileError: if it cannot be written; what was there before is there still.
    """
    try:
        place = path.resolve()
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


def _is_same(first: Path, second: Path) -> bool:
    """Whether two paths lead to one file, by hard links too."""
    try:
        return first.samefile(second)
    except OSError:
        return False
