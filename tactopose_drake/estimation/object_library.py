"""Many known objects: a folder of meshes or a manifest, indexed so that identification estimates only a few of them.

`LibraryIndex` holds what identification needs of every object, some 20 kB each; an object's model is loaded only when
it is a candidate. Both are cached on disk by the mesh's content (see `model_cache`) as soon as they are built, so that
an interrupted indexing continues where it stopped, and a changed mesh is indexed again.
"""

from __future__ import annotations

import dataclasses
import functools
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from pathlib import Path
from typing import Any, NamedTuple

from numpy.typing import NDArray

from tactopose_drake.core.identification.library_index import SAMPLES, LibraryIndex, PairCounts, count_pairs
from tactopose_drake.core.mesh.loading import load_mesh
from tactopose_drake.core.mesh.repair import MeshRepairWarning
from tactopose_drake.core.plain_values import counted
from tactopose_drake.core.shape import model_cache
from tactopose_drake.core.shape.model_building import file_content
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import path_of
from tactopose_drake.errors import InvalidFileError, InvalidInputError
from tactopose_drake.estimation.executor_errors import as_done, handing_over
from tactopose_drake.estimation.library_files import LibraryEntry, SkippedObject, make_symmetries, read_library

MAX_GRID_BYTES = 2 * 2**20
"""The largest distance grid of an object in a library, bytes."""

_KEPT_BYTES = 2.8e6  # disk space of an object's cached data, about

_LOADED = 128  # number of recently used models that are kept in memory, some 6 MB each

Progress = Callable[[int, int], None]
"""A callback that gets the number of objects that are indexed, and their total."""


class LibraryWarning(UserWarning):
    """A library's object is skipped, or the library does not fit in the cache."""


@dataclasses.dataclass(frozen=True)
class LibraryObject:
    """An object in a library, whose model is loaded on demand.

    Attributes:
        entry: its name, file and properties.
        content: hash of the mesh and its scale, 32 hexadecimal digits.
    """

    entry: LibraryEntry
    content: str

    @property
    def name(self) -> str:
        """The object's name."""
        return self.entry.name

    def load(self) -> ObjectModel:
        """Loads its model; recently used models are kept in memory.

        Raises:
            InvalidFileError: if the mesh no longer exists, or has changed since the library was opened.
        """
        return _load(self)


@dataclasses.dataclass(frozen=True, eq=False)
class ObjectLibrary:
    """The known objects among which a touched one is identified.

    Attributes:
        objects: the objects, sorted by name.
        skipped: objects that were skipped, with reasons.
        index: pair features of the objects, in the same order.
    """

    objects: tuple[LibraryObject, ...]
    skipped: tuple[SkippedObject, ...]
    index: LibraryIndex

    def __len__(self) -> int:
        return len(self.objects)

    def __repr__(self) -> str:
        left_out = f", {len(self.skipped)} left out" if self.skipped else ""
        return f"<ObjectLibrary: {counted(len(self), 'object', 'objects')}{left_out}>"

    @classmethod
    def open(
        cls, path: str | Path, *, executor: Executor | None = None, on_progress: Progress | None = None
    ) -> ObjectLibrary:
        """Reads a library, and indexes the objects that are not indexed yet.

        Args:
            path: a folder of meshes, each an object with its file's name; or a manifest (see `read_library`).
            executor: indexes several objects at a time; None: one after the other.
            on_progress: called after each object.

        Raises:
            InvalidFileError: if there is no such folder or file, the manifest does not fit its format, or no object can
                be used.
            InvalidInputError: if `path` is not a path, or the executor is shut down or loses its workers.

        Warns:
            LibraryWarning: for each object that is skipped, and if the objects do not fit in the cache on disk.
        """
        entries, skipped = read_library(path_of("path", path))
        _check_room(path, len(entries))
        indexed: list[tuple[LibraryObject, PairCounts]] = []
        for done, (entry, outcome) in enumerate(_index_all(entries, executor), start=1):
            if isinstance(outcome, str):
                skipped.append(SkippedObject(entry.name, outcome))
            else:
                indexed.append((LibraryObject(entry, outcome.content), outcome.pairs))
            if on_progress is not None:
                on_progress(done, len(entries))
        for left_out in skipped:
            warnings.warn(f"{path}: {left_out}", LibraryWarning, stacklevel=2)
        if not indexed:
            reason = f" ({skipped[0]})" if skipped else ""
            raise InvalidFileError(f"{path} must hold at least one object that can be used, but holds none{reason}.")
        indexed.sort(key=lambda pair: pair[0].name)
        return cls(
            tuple(known for known, _ in indexed), tuple(skipped), LibraryIndex.join([pairs for _, pairs in indexed])
        )


def _check_room(path: str | Path, count: int) -> None:
    """Warns if the cache cannot hold this many objects: those dropped would be rebuilt each time."""
    needed, limit = count * _KEPT_BYTES / 1e9, model_cache.cache_limit() / 1e9
    if needed > limit:
        message = f"{path}: {count} objects take about {needed:.1f} GB; {model_cache.LIMIT_VARIABLE} allows {limit:g}."
        warnings.warn(message, LibraryWarning, stacklevel=3)


class _Indexed(NamedTuple):
    content: str
    pairs: PairCounts


def _index_all(entries: list[LibraryEntry], executor: Executor | None) -> Iterator[tuple[LibraryEntry, _Indexed | str]]:
    """Each entry with its index, or the reason why there is none; entries that are cached on disk come first."""
    missing = []
    for entry in entries:
        try:
            content = _content(entry)
        except InvalidInputError as error:
            yield entry, str(error)
            continue
        arrays = model_cache.load(_key(content))
        pairs = None if arrays is None else PairCounts.from_arrays(arrays)
        if pairs is None:
            missing.append(entry)
        else:
            yield entry, _Indexed(content, pairs)
    if executor is None:
        yield from ((entry, _index(entry)) for entry in missing)
        return
    with handing_over():
        futures: dict[Future[_Indexed | str], LibraryEntry] = {
            executor.submit(_index, entry): entry for entry in missing
        }
    try:
        for future, outcome in as_done(futures):
            yield futures[future], outcome
    finally:
        for future in futures:
            future.cancel()


def _index(entry: LibraryEntry) -> _Indexed | str:
    """Indexes an object and caches the result; returns the reason as text if that is impossible."""
    try:
        known = LibraryObject(entry, _content(entry))
        pairs = count_pairs(_build(known).samples)
    except InvalidInputError as error:
        return str(error)
    model_cache.store(_key(known.content), {"bins": pairs.bins, "counts": pairs.counts})
    return _Indexed(known.content, pairs)


def _content(entry: LibraryEntry) -> str:
    content: tuple[bytes | NDArray[Any] | str, ...] | None = file_content(entry.mesh)
    if content is None:
        raw = load_mesh(entry.mesh)
        content = raw.vertices, raw.faces
    return model_cache.content_key(*content, *([] if entry.scale == 1.0 else [f"{entry.scale!r}"]))


def _key(content: str) -> str:
    return model_cache.content_key(content, f"pair counts of {SAMPLES} samples, 2")


def forget_models() -> None:
    """Frees the memory of the models that libraries' objects have loaded."""
    _load.cache_clear()


@functools.lru_cache(maxsize=_LOADED)
def _load(known: LibraryObject) -> ObjectModel:
    if _content(known.entry) != known.content:
        raise InvalidFileError(f"{known.entry.mesh} has changed since the library was opened. Open the library again.")
    return _build(known)


def _build(known: LibraryObject) -> ObjectModel:
    """Builds the model, with fewer samples and a smaller grid than usual because a library has many objects."""
    symmetry = known.entry.symmetry
    with warnings.catch_warnings():
        # A warning for each of many meshes would be too much; `ObjectModel.repairs` lists the repairs.
        warnings.simplefilter("ignore", MeshRepairWarning)
        return ObjectModel.from_mesh(
            known.entry.mesh,
            name=known.name,
            scale=known.entry.scale,
            mass=known.entry.mass,
            surface_sigma=known.entry.surface_sigma,
            scale_sigma=known.entry.scale_sigma,
            symmetry=symmetry if isinstance(symmetry, str) else make_symmetries(symmetry),
            samples=SAMPLES,
            max_grid_bytes=MAX_GRID_BYTES,
        )
