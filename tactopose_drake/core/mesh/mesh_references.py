"""The files that a mesh file refers to: read if they are in its own folder or below, never written."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from trimesh.resolvers import Resolver


class ReferencedFiles(Resolver):
    """Gives trimesh's readers access to the files that a mesh file refers to.

    Only to regular files in the folder or below it, with all symbolic links resolved, and of limited size.
    """

    def __init__(self, folder: Path, largest: int) -> None:
        """Takes the mesh file's folder, and the size of the largest file that may be read, bytes; 0 for none."""
        self._folder, self._largest = folder.resolve(), largest

    def get(self, key: str) -> bytes:
        """The content of a file.

        Raises:
            FileNotFoundError: if there is none that may be read.
        """
        path = (self._folder / key.strip()).resolve()
        bounded = path.is_file() and path.stat().st_size <= self._largest
        # A glTF reader that cannot read a file would use `model.gltf` instead.
        if not bounded or not path.is_relative_to(self._folder) or path.suffix.lower() == ".gltf":
            raise FileNotFoundError(f"the file that it names, {key[:100]!r}, is not one that may be read")
        return path.read_bytes()

    def write(self, name: str, data: object) -> None:
        """Always refuses."""
        raise PermissionError(f"{name!r} may not be written")

    def namespaced(self, namespace: str) -> ReferencedFiles:
        """The files of a subfolder."""
        folder = (self._folder / namespace).resolve()
        return ReferencedFiles(folder, self._largest if folder.is_relative_to(self._folder) else 0)

    def keys(self) -> Iterator[str]:
        """Empty: files are only accessed by name."""
        return iter(())
