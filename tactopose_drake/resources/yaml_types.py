"""Reading YAML into dataclasses; errors name the line and the allowed values."""

import copy
import dataclasses
import functools
import types
import typing
from collections.abc import Sequence
from pathlib import Path
from typing import Any, TypeVar

import yaml
from pydrake.common.yaml import yaml_load_typed

from tactopose_drake.errors import InvalidFileError
from tactopose_drake.resources.yaml_files import (
    DECIMAL,
    NOT_FINITE,
    YAML,
    bare,
    check_key,
    number_of,
    parse_yaml,
    read_text,
    shown,
    where,
)

Schema = TypeVar("Schema")

_MAX_BYTES = 2**18  # of a file that is read into a dataclass; the package's largest has 4000


def load_typed_yaml(schema: type[Schema], path: Path) -> Schema:
    """Reads a YAML file into an instance of a dataclass; unknown keys are errors, absent keys keep their defaults.

    Ranges are not checked here: `yaml_load_typed` bypasses `__post_init__`, so the schema's `validate` does it.

    Raises:
        InvalidFileError: if the file cannot be read or does not fit the schema; the message is one line that names the
            file, the line and what is allowed.
    """
    text = read_text(path, _MAX_BYTES)
    try:
        data: Schema = copy.deepcopy(_load(typing.cast(Any, schema), text))
    except InvalidFileError as error:
        raise InvalidFileError(f"{path}: {error}") from None
    except Exception as error:  # the loader raises AttributeError, AssertionError, RuntimeError ... on bad content
        reason = " ".join(str(error).split()) or type(error).__name__
        raise InvalidFileError(f"{path}: {shown(reason)}") from error
    return data


@functools.lru_cache(maxsize=64)
def _load(schema: Any, text: str) -> Any:
    """The content of a text, cached, because commands read the same files many times, and Drake's loader is slow."""
    root = parse_yaml(text)
    if root is None:
        raise InvalidFileError("the file must not be empty.")
    check_type(schema, root)
    # Drake parses by other rules, tabs for instance, and must read what was checked.
    return yaml_load_typed(schema=schema, data=yaml.serialize(root))


def check_type(kind: Any, node: yaml.Node, place: str = "") -> None:
    """Raises InvalidFileError at the first node that does not fit; the message begins with its line.

    Args:
        kind: a dataclass, one of Drake's types for YAML, list, dict with string keys, int, float, bool, str, or a union
            of these.
        node: the node to be read into it.
        place: place of the node in its file, for messages.
    """
    options = typing.get_args(kind) if isinstance(kind, types.UnionType) else (kind,)
    if type(None) in options:
        if node.tag == YAML + "null":
            return
        options = tuple(option for option in options if option is not type(None))
    if node.tag.startswith("!") and not _is_drakes(options[0]):
        tag, names = node.tag.removeprefix("!"), [option.__name__ for option in options] if len(options) > 1 else []
        if tag not in names:
            allowed = f"one of the tags {', '.join(f'!{name}' for name in names)}" if names else "no tag"
            raise InvalidFileError(f"{where(node, place)} must have {allowed}, not {bare(node.tag)}.")
        options = tuple(option for option in options if option.__name__ == tag)
    kind = options[0]
    if dataclasses.is_dataclass(kind):
        _check_dataclass(typing.cast(type, kind), node, place, [f"!{option.__name__}" for option in options[1:]])
    elif _is_drakes(kind):
        _check_drakes(kind, node, place)
    elif typing.get_origin(kind) is list:
        if not isinstance(node, yaml.SequenceNode):
            raise InvalidFileError(f"{where(node, place)} must be a list, not {_shown_node(node)}.")
        for i, item in enumerate(node.value):
            check_type(typing.get_args(kind)[0], item, f"{place}[{i}]")
    elif typing.get_origin(kind) is dict:
        if not isinstance(node, yaml.MappingNode):
            raise InvalidFileError(f"{where(node, place)} must be a mapping, not {_shown_node(node)}.")
        for key, value in node.value:
            check_key(key, place)
            check_type(typing.get_args(kind)[1], value, f"{place}.{key.value}")
    else:
        _check_scalar(options, node, place)


def _check_dataclass(kind: type, node: yaml.Node, place: str, others: Sequence[str]) -> None:
    """Checks the mapping of a dataclass; `others` are the tags with which another dataclass would be read."""
    types_of = typing.get_type_hints(kind)
    if not isinstance(node, yaml.MappingNode):
        keys = f"whose keys may be {', '.join(types_of)}"
        raise InvalidFileError(f"{where(node, place)} must be a mapping, {keys}, not {_shown_node(node)}.")
    for key, value in node.value:
        if not place and key.value.startswith("_"):  # values that other keys refer to by anchors
            continue
        if key.value not in types_of:
            allowed = f"only the keys {', '.join(types_of)}" if types_of else "no keys"
            allowed += f" (or, with a tag, {', '.join(others)}, its own)" if others else ""
            raise InvalidFileError(f"{where(key, place)} must have {allowed}, not {shown(key.value)}.")
        check_type(types_of[key.value], value, f"{place}.{key.value}".lstrip("."))


def _check_scalar(options: tuple[Any, ...], node: yaml.Node, place: str) -> None:
    """Checks a scalar that may be of several of the types str, bool, int and float."""
    name = node.tag.removeprefix(YAML)
    if {int, float}.intersection(options) and (name in ("int", "float") or not {str, bool}.intersection(options)):
        if name == "bool":
            raise InvalidFileError(f"{where(node, place)} must be a number, not {shown(node.value)}, a yes or no.")
        number_of(node, place, whole=float not in options)
        if name == "str" and DECIMAL.fullmatch(node.value) is None:  # Drake's loader reads 0x20 only without quotes.
            raise InvalidFileError(f"{where(node, place)} must be a number without quotes, not {shown(node.value)}.")
    elif str in options and name != "str" and not (name == "bool" and bool in options):
        raise InvalidFileError(f"{where(node, place)} must be text, in quotes if need be, not {_shown_node(node)}.")
    elif str not in options and name != "bool" and node.value not in ("true", "false"):
        raise InvalidFileError(f"{where(node, place)} must be true or false, not {_shown_node(node)}.")


def _check_drakes(kind: type, node: yaml.Node, place: str) -> None:
    _check_finite(node, place)
    try:
        yaml_load_typed(schema=kind, data=yaml.serialize(node))
    except Exception:  # it raises AttributeError, AssertionError, RuntimeError ... on bad content
        keys = ", ".join(field.name for field in kind.__fields__)  # type: ignore[attr-defined]
        tag = " A rotation has a tag, as in `rotation: !Rpy {deg: [180, -90, 0]}`." if "rotation" in keys else ""
        message = f"{where(node, place)} must fit Drake's {kind.__name__}, whose keys may be {keys}.{tag}"
        raise InvalidFileError(message) from None


def _check_finite(node: yaml.Node, place: str) -> None:
    """Checks all numbers in one of Drake's types; booleans in lists are errors, too."""
    if isinstance(node, yaml.MappingNode):
        for key, value in node.value:
            check_key(key, place)
            _check_finite(value, f"{place}.{key.value}")
    elif isinstance(node, yaml.SequenceNode):
        for i, item in enumerate(node.value):
            if item.tag == YAML + "bool":
                number_of(item, f"{place}[{i}]")
            _check_finite(item, f"{place}[{i}]")
    elif any(node.tag == YAML + name for name in ("int", "float")) or _is_number_as_text(node.value):
        number_of(node, place)


def _is_number_as_text(text: str) -> bool:
    """Whether Drake would read a string, such as 1e-8, as a number."""
    return DECIMAL.fullmatch(text) is not None or NOT_FINITE.fullmatch(text) is not None


def _is_drakes(kind: Any) -> bool:
    return hasattr(kind, "__fields__")


def _shown_node(node: yaml.Node) -> str:
    if isinstance(node, yaml.ScalarNode):
        return shown(node.value)
    return "a list" if isinstance(node, yaml.SequenceNode) else "a mapping"
