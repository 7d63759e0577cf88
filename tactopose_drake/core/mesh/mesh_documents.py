"""Limits the size of meshes from files that expand: archives, and parts that consist of parts.

Both are determined from the file itself, before a reader unpacks the former and places the latter.
"""

from __future__ import annotations

import json
import struct
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.parsers import expat

from tactopose_drake.errors import InvalidFileError

MOST_PARTS = 2000
"""How often a file may place meshes; those within groups count each time the group is placed."""

# The elements that define a part or group, and those that place one, with the attribute that names it.
_DEFINING = {"object": "id", "node": "id", "visual_scene": "id"}
_PLACING = {"component": "objectid", "item": "objectid", "instance_node": "url", "instance_visual_scene": "url"}
_WHOLE = ""  # stands for the file itself among the names of parts

_MOST_GLTF_NUMBERS = 60_000_000  # rows of all accessors, which need no data in the file unless they name a buffer


def check_document(path: Path, largest: int) -> None:
    """Rejects a file that unpacks to more than `largest` bytes, or that places more than `MOST_PARTS` parts.

    Raises:
        InvalidFileError: if it does.
        zipfile.BadZipFile: if an archive is damaged.
        expat.ExpatError, ValueError: if a description is damaged.
    """
    ending = path.suffix.lower()
    if ending in (".gltf", ".glb"):
        tree = _gltf_tree(path.read_bytes(), ending)
        rows = sum(int(accessor["count"]) for accessor in tree.get("accessors", []))
        if rows > _MOST_GLTF_NUMBERS:
            raise InvalidFileError(f"{path} must list at most {_MOST_GLTF_NUMBERS} rows of numbers, not {rows}.")
        if len(tree.get("nodes", [])) > MOST_PARTS:
            raise InvalidFileError(f"{path} must have at most {MOST_PARTS} nodes, not {len(tree['nodes'])}.")
    for content in _descriptions(path, largest):
        parts = _count_parts(content)
        if parts > MOST_PARTS:
            raise InvalidFileError(f"{path} must place at most {MOST_PARTS} parts.")


def _gltf_tree(content: bytes, ending: str) -> dict[str, Any]:
    """The JSON content of a glTF file, without its buffers."""
    if ending == ".glb":
        (length,) = struct.unpack_from("<I", content, 12)
        content = content[20 : 20 + length]
    tree: dict[str, Any] = json.loads(content)
    return tree


def _descriptions(path: Path, largest: int) -> Iterator[bytes]:
    """The XML documents that define a file's parts."""
    if path.suffix.lower() == ".dae":
        yield path.read_bytes()
    elif path.suffix.lower() in (".3mf", ".zae"):
        with zipfile.ZipFile(path) as archive:
            # No reader unpacks more of an entry than the archive's directory states.
            size = sum(entry.file_size for entry in archive.infolist())
            if size > largest:
                raise InvalidFileError(f"{path} must unpack to at most {largest} bytes, not {size}.")
            for entry in archive.infolist():
                if entry.filename.lower().endswith((".model", ".dae")):
                    yield archive.read(entry)


def _count_parts(content: bytes) -> int:
    """Number of parts placed, at most one above the limit; a part that contains itself is placed infinitely often."""
    children: dict[str, list[str]] = {_WHOLE: []}
    open_parts: list[tuple[str, str]] = []

    def start(tag: str, attributes: dict[str, str]) -> None:
        name = tag.rpartition(":")[2]
        if name in _DEFINING:
            part = attributes.get(_DEFINING[name], "")
            open_parts.append((tag, part))
            if part:
                children.setdefault(part, [])
        elif name in _PLACING:
            placed = attributes.get(_PLACING[name], "").lstrip("#")
            for part in {part for _, part in open_parts if part} or {_WHOLE}:
                children[part].append(placed)

    def end(tag: str) -> None:
        if open_parts and open_parts[-1][0] == tag:
            open_parts.pop()

    parser = expat.ParserCreate()
    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.Parse(content, True)

    counts: dict[str, int] = {}
    pending, begun = [_WHOLE], set()
    while pending:
        part = pending[-1]
        missing = [child for child in children.get(part, []) if child not in counts]
        if not missing:
            placed_here = sum(counts[child] for child in children.get(part, []))
            counts[pending.pop()] = min(1 + placed_here, MOST_PARTS + 1)
        elif part in begun and any(child in begun for child in missing):
            return MOST_PARTS + 1
        else:
            begun.add(part)
            pending.append(missing[0])
    return counts[_WHOLE]
