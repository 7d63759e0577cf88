"""The files that an input file depends on: those that it names, those that these name, and so on.

A hand's file names a model, which names meshes; a scenario names a hand, an object, a prior. In any format, a string
that is the path of an existing file, relative to the naming file's folder, counts as a reference to it.
"""

import contextlib
import os
import re
from collections.abc import Iterator
from pathlib import Path

import yaml

from tactopose_drake.errors import InvalidFileError
from tactopose_drake.resources.yaml_files import MAX_BYTES, read_text, read_yaml

_XML = frozenset({".sdf", ".urdf", ".xml"})
_BINARY = frozenset({".3mf", ".blf", ".dae", ".glb", ".obj", ".off", ".ply", ".stl", ".vtk", ".zae"})
_LARGEST = 2**24  # bytes of a file of models
_LONGEST = 1000  # characters of a name
_XML_TEXTS = re.compile(r"""="([^"]*)"|='([^']*)'|>([^<>]*)<""")
_XML_FOLDERS = re.compile(r"""\b(?:meshdir|assetdir)\s*=\s*["']([^"']+)["']""")
_GLTF_NAMES = re.compile(r'"uri"\s*:\s*"([^"]*)"')
_OF_FOLDERS = ("manifest.yaml", "library.yaml")  # of a recording, of a library of objects


def files_behind(path: Path) -> Iterator[Path]:
    """Yields a file or folder that is read, and all files and folders that it names directly or indirectly.

    A file that cannot be read names none; `package://` and other URLs are ignored.
    """
    waiting, seen = [path], set()
    while waiting:
        found = waiting.pop()
        place = os.path.realpath(found)
        if place not in seen:
            seen.add(place)
            yield found
            with contextlib.suppress(InvalidFileError, OSError, ValueError):
                waiting += _named_in(found)


def _named_in(path: Path) -> Iterator[Path]:
    """The files and folders that a file names, or a folder's own file."""
    ending = path.suffix.lower()
    if path.is_dir():
        yield from (path / name for name in _OF_FOLDERS if (path / name).is_file())
    elif not path.is_file() or ending in _BINARY:
        return
    elif ending in _XML:
        text = read_text(path, _LARGEST)
        names = {"".join(texts).strip() for texts in _XML_TEXTS.findall(text)}
        folders = [path.parent, *(path.parent / folder for folder in _XML_FOLDERS.findall(text))]
        yield from _existing(folders, names)
        # The mesh of a scenario's object.
        yield from _existing([path.parent], {f"{path.stem}.obj"})
    elif ending == ".gltf":
        yield from _existing([path.parent], set(_GLTF_NAMES.findall(read_text(path, _LARGEST))))
    elif path.stat().st_size <= MAX_BYTES:
        yield from _in_yaml(path.parent, read_yaml(path))


def _in_yaml(folder: Path, node: yaml.Node | None) -> Iterator[Path]:
    """Files that strings of a mapping or list name, including its keys, and files of a mapping's `folder`."""
    if isinstance(node, yaml.ScalarNode):
        yield from _existing([folder], {node.value})
    elif isinstance(node, yaml.SequenceNode):
        for item in node.value:
            yield from _in_yaml(folder, item)
    elif isinstance(node, yaml.MappingNode):
        keys = {key.value for key, _ in node.value}
        for key, value in node.value:
            yield from _in_yaml(folder, key)
            yield from _in_yaml(folder, value)
            # The folder of a Python distribution is not relative to this file.
            if key.value == "folder" and isinstance(value, yaml.ScalarNode) and "distribution" not in keys:
                yield from _in_folder(folder / value.value)


def _in_folder(folder: Path) -> Iterator[Path]:
    """The folder itself if it is a recording; otherwise the tables in it."""
    if (folder / _OF_FOLDERS[0]).is_file():
        yield folder
    else:
        yield from folder.glob("*.csv")


def _existing(folders: list[Path], names: set[str]) -> Iterator[Path]:
    for name in names:
        if name and len(name) <= _LONGEST and "\0" not in name:
            for folder in folders:
                file = folder / name.removeprefix("file://")
                if os.path.isfile(file):
                    yield file
