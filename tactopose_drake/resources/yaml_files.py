"""Reading untrusted YAML: with size limits, without duplicate keys, and only plain data.

`read_yaml` parses a file into a tree of nodes, which `plain_data` converts to Python's numbers, strings, lists and
dicts. Every error is an `InvalidFileError`.
"""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import yaml

from tactopose_drake.errors import InvalidFileError

MAX_BYTES = 2**20
"""Maximum size of a file, bytes."""
MAX_DEPTH = 24
"""Maximum nesting of lists and mappings."""
MAX_LETTERS = 1000
"""Maximum length of a value or key."""
LARGEST = 1e15
"""Largest number that is not an integer, in SI units; its powers are finite."""
MAX_NODES = 200_000
"""Maximum number of values and keys of a file; those of an alias are counted at each use."""

_Loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)  # libyaml's is forty times as fast, if PyYAML has it
YAML = "tag:yaml.org,2002:"
_PLAIN_TAGS = {YAML + name for name in ("null", "bool", "int", "float", "str", "seq", "map", "timestamp", "merge")}
_INTEGER = re.compile(r"[-+]?(0|[1-9][0-9]*)|0x[0-9a-fA-F]+")
DECIMAL = re.compile(r"[-+]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][-+]?[0-9]+)?")
NOT_FINITE = re.compile(r"[-+]?\.?(inf|Inf|INF|nan|NaN|NAN)")
_SHOWN = 60  # characters of a value in a message


def read_yaml(path: Path) -> yaml.Node | None:
    """The tree of a file, with merge keys (`<<`) resolved; None for an empty file.

    Raises:
        InvalidFileError: if the file cannot be read, is not YAML in UTF-8, or exceeds the limits.
    """
    text = read_text(path, MAX_BYTES)
    try:
        return parse_yaml(text)
    except InvalidFileError as error:
        raise InvalidFileError(f"{path}: {error}") from None


def read_text(path: Path, max_bytes: int) -> str:
    """The text of a file.

    Raises:
        InvalidFileError: if the file cannot be read, is not text in UTF-8, or is longer than `max_bytes`.
    """
    try:
        with path.open("rb") as file:
            content = file.read(max_bytes + 1)
    except OSError as error:
        raise InvalidFileError(f"{path} cannot be read ({error.strerror}).") from None
    except ValueError:  # a path with a NUL in it
        raise InvalidFileError(f"{path} cannot be read (it is not a path).") from None
    if len(content) > max_bytes:
        raise InvalidFileError(f"{path} must have at most {max_bytes} bytes, not more.")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InvalidFileError(f"{path} cannot be read (it is not text in UTF-8, at byte {error.start}).") from None


def parse_yaml(text: str) -> yaml.Node | None:
    """The tree of a text; None for an empty one.

    Raises:
        InvalidFileError: if it is not YAML, or exceeds the limits.
    """
    try:
        return _Composer(text).document()
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        where = f" at line {mark.line + 1}, column {mark.column + 1}" if mark else ""
        reason = " ".join(str(getattr(error, "problem", None) or error).split())
        raise InvalidFileError(f"the content is not YAML{where} ({reason}).") from None


class _Composer:
    """Composes the parser's events into nodes, and checks the limits."""

    def __init__(self, text: str) -> None:
        self._events: Iterator[Any] = yaml.parse(text, Loader=_Loader)
        self._resolver: Any = yaml.resolver.Resolver()
        # The node of each anchor and its number of values; None while the node is incomplete.
        self._anchors: dict[str, tuple[yaml.Node, int] | None] = {}
        self._count = 0

    def document(self) -> yaml.Node | None:
        root: yaml.Node | None = None
        for event in self._events:
            if isinstance(event, yaml.DocumentStartEvent):
                if root is not None:
                    raise InvalidFileError(f"{_line(event)}the file must hold 1 document, not begin a second one.")
                root = self._node(next(self._events), 0)
        return root

    def _node(self, event: Any, depth: int) -> yaml.Node:
        before = self._count
        mark: Any = event.start_mark
        if isinstance(event, yaml.AliasEvent):
            found = self._anchors.get(str(event.anchor))
            if found is None:
                raise InvalidFileError(f"{_line(event)}*{bare(str(event.anchor))} stands for nothing before it.")
            self._add(event, found[1])
            return found[0]
        if depth > MAX_DEPTH:
            raise InvalidFileError(f"{_line(event)}values must be nested at most {MAX_DEPTH} deep, not deeper.")
        self._add(event, 1)
        anchor = event.anchor
        if anchor is not None:
            self._anchors[anchor] = None
        node: yaml.Node
        if isinstance(event, yaml.ScalarEvent):
            node = self._scalar(event)
        elif isinstance(event, yaml.SequenceStartEvent):
            items = []
            while not isinstance(inner := next(self._events), yaml.SequenceEndEvent):
                items.append(self._node(inner, depth + 1))
            node = yaml.SequenceNode(self._tag(yaml.SequenceNode, event), items, mark)
        else:
            pairs = []
            while not isinstance(inner := next(self._events), yaml.MappingEndEvent):
                pairs.append((self._node(inner, depth + 1), self._node(next(self._events), depth + 1)))
            node = yaml.MappingNode(self._tag(yaml.MappingNode, event), _merged(pairs), mark)
        if node.tag.startswith("tag:") and node.tag not in _PLAIN_TAGS:
            raise InvalidFileError(f"{_line(event)}the tag must be one of plain data, not {bare(node.tag)}.")
        if anchor is not None:
            self._anchors[anchor] = node, self._count - before
        return node

    def _scalar(self, event: Any) -> yaml.ScalarNode:
        if any(ord(letter) < 32 or 127 <= ord(letter) < 160 for letter in event.value):
            raise InvalidFileError(
                f"{_line(event)}{shown(event.value)} must be in one line, and without control characters."
            )
        if len(event.value) > MAX_LETTERS:
            raise InvalidFileError(
                f"{_line(event)}{shown(event.value)} must have at most {MAX_LETTERS} letters, not {len(event.value)}. "
                "No file of this package has such a text: this may be a mesh, or another file that is not YAML."
            )
        return yaml.ScalarNode(
            self._tag(yaml.ScalarNode, event), event.value, event.start_mark, event.end_mark, event.style
        )

    def _tag(self, kind: type[yaml.Node], event: Any) -> str:
        if event.tag is not None and event.tag != "!":
            return str(event.tag)
        return str(self._resolver.resolve(kind, getattr(event, "value", None), event.implicit))

    def _add(self, event: Any, count: int) -> None:
        self._count += count
        if self._count > MAX_NODES:
            raise InvalidFileError(f"{_line(event)}the file must hold at most {MAX_NODES} values, not more.")


def _merged(pairs: list[tuple[yaml.Node, yaml.Node]]) -> list[tuple[yaml.Node, yaml.Node]]:
    """The unique pairs of a mapping, followed by those that `<<` merges."""
    own: dict[tuple[str, str], tuple[yaml.Node, yaml.Node]] = {}
    brought: list[tuple[yaml.Node, yaml.Node]] = []
    for key, value in pairs:
        if not isinstance(key, yaml.ScalarNode):
            raise InvalidFileError(f"{_line(key)}a key must be text, not a list or mapping.")
        if (key.tag, key.value) in own:
            raise InvalidFileError(f"{_line(key)}the key {shown(key.value)} must be given once, not twice.")
        own[key.tag, key.value] = key, value
        if key.tag == YAML + "merge":
            maps = value.value if isinstance(value, yaml.SequenceNode) else [value]
            if not all(isinstance(part, yaml.MappingNode) for part in maps):
                raise InvalidFileError(f"{_line(key)}<< must merge mappings only.")
            brought += [pair for part in maps for pair in part.value]
    own = {name: pair for name, pair in own.items() if name[0] != YAML + "merge"}
    for key, value in brought:
        own.setdefault((key.tag, key.value), (key, value))
    return list(own.values())


def plain_data(node: yaml.Node | None, place: str = "") -> Any:
    """Converts a tree to lists, dicts with string keys, strings, numbers, booleans and None.

    A date becomes a string, and NaN a number.

    Raises:
        InvalidFileError: if a number, key or tag is not allowed; the message begins with the line.
    """
    if node is None:
        return None
    if node.tag.startswith("!"):
        raise InvalidFileError(f"{where(node, place)} must have no tag, not {bare(node.tag)}.")
    if isinstance(node, yaml.SequenceNode):
        return [plain_data(item, f"{place}[{i}]") for i, item in enumerate(node.value)]
    if isinstance(node, yaml.MappingNode):
        for key, _ in node.value:
            check_key(key, place)
        return {key.value: plain_data(value, f"{place}.{key.value}".lstrip(".")) for key, value in node.value}
    if node.tag in (YAML + "int", YAML + "float"):
        return float(node.value.replace(".", "")) if NOT_FINITE.fullmatch(node.value) else number_of(node, place)
    if node.tag == YAML + "bool":
        return node.value.lower() in ("yes", "true", "on")
    if node.tag == YAML + "null":
        return None
    # To YAML, 1e-8 is a string.
    is_quoted = isinstance(node, yaml.ScalarNode) and bool(node.style)
    return number_of(node, place) if not is_quoted and DECIMAL.fullmatch(node.value) else node.value


def number_of(node: yaml.Node, place: str, *, whole: bool = False) -> float | int:
    """The finite number of a node: 3, 0x20, 2.5 and 1e-8 are allowed; 010, 1_000, 12:30 and other YAML forms are not.

    Raises:
        InvalidFileError: if the node is not such a number.
    """
    allowed = "an integer" if whole else "a number"
    if not isinstance(node, yaml.ScalarNode):
        raise InvalidFileError(f"{where(node, place)} must be {allowed}, not a list or mapping.")
    if _INTEGER.fullmatch(node.value):
        # Numbers with more digits than 64 bits can have are not parsed, because that may take long.
        number = int(node.value, 0) if len(node.value) <= 20 else 2**63
        if -(2**63) <= number < 2**63:
            return number
        allowed = "an integer of 64 bits"
    elif DECIMAL.fullmatch(node.value) and not whole and not _is_octal(node.value):
        if abs(decimal := float(node.value)) <= LARGEST:
            return decimal
        allowed = f"a number from {-LARGEST:g} to {LARGEST:g}"
    elif NOT_FINITE.fullmatch(node.value) and not whole:
        allowed = "a finite number"
    raise InvalidFileError(f"{where(node, place)} must be {allowed}, not {shown(node.value)}.")


def _is_octal(text: str) -> bool:
    return re.fullmatch(r"[-+]?0[0-9]+", text) is not None


def shown(value: object) -> str:
    """A value for messages: quoted, in one line, and shortened."""
    text = repr(value)
    return text if len(text) <= _SHOWN else f"{text[:_SHOWN]}..."


def bare(text: str) -> str:
    """Text for messages: without quotes, and shortened."""
    return text if len(text) <= _SHOWN else f"{text[:_SHOWN]}..."


def check_key(key: yaml.Node, place: str) -> None:
    """Raises InvalidFileError if a key is not a string."""
    if key.tag != YAML + "str":
        raise InvalidFileError(
            f"{where(key, place)} must have keys of text, in quotes if need be, not {bare(key.value)}."
        )


def where(node: yaml.Node, place: str) -> str:
    """The beginning of a message: the line, and the place in the file, which is the subject of the sentence."""
    return _line(node) + (place or "the content")


def _line(node: Any) -> str:
    return f"line {node.start_mark.line + 1}: "
