"""The other files that a mesh file names: read where they are in its own folder or below, never written."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from trimesh.resolvers import Resolver


class ReferencedFiles(Resolver):
    """Hands a reader of trimesh the files that a mesh file names.

    Only regular files in the folder or below it, after all symbolic links, and of a bounded size.
    """

    def __init__(self, folder: Path, largest: int) -> None:
        """Takes the mesh file's folder, and the size of the largest file that may be read, bytes; 0: none at all."""
        self._folder, self._largest = folder.resolve(), largest

    def get(self, key: str) -> bytes:
        """The content of a file.

        Raises:
            FileNotFoundError: if there is none that may be read.
        """
        path = (self._folder / key.strip()).resolve()
        bounded = path.is_file() and path.stat().st_size <= self._largest
        # A reader of glTF that cannot read a file would take `model.gltf` in its place.
        if not bounded or not path.is_relative_to(self._folder) or path.suffix.lower() == ".gltf":
            raise FileNotFoundError(f"the file that it names, {key[:100]!r}, is not one that may be read")
        return path.read_bytes()

    def write(self, name: str, data: object) -> None:
        """Nothing is ever written."""
        raise PermissionError(f"{name!r} may not be written")

    def namespaced(self, namespace: str) -> ReferencedFiles:
        """The files of a folder below."""
        folder = (self._folder / namespace).resolve()
        return ReferencedFiles(folder, self._largest if folder.is_relative_to(self._folder) else 0)

    def keys(self) -> Iterator[str]:
        """No list of files: a mesh asks for what it names."""
        return iter(())
