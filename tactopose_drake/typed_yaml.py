"""Reading a YAML file into a dataclass, with one clear error when that fails."""

import dataclasses
import types
import typing
from pathlib import Path
from typing import Any, TypeVar

import yaml
from pydrake.common.yaml import yaml_load_typed

from tactopose_drake.errors import InvalidFileError

Schema = TypeVar("Schema")


def load_typed_yaml(schema: type[Schema], path: Path) -> Schema:
    """Reads a YAML file into an instance of a dataclass; unknown keys are errors, absent keys keep their defaults.

    Ranges are not checked here: `yaml_load_typed` bypasses `__post_init__`, so the schema's `validate` does it.

    Raises:
        InvalidFileError: if the file cannot be read or does not fit the schema; the message is one line that names the
            file and, of a misspelt key or tag and of a number that is none, the line and what is allowed.
    """
    try:
        data: Schema = yaml_load_typed(schema=schema, filename=str(path))
    except OSError as error:
        raise InvalidFileError(f"{path}: cannot be read ({error.strerror}).") from error
    except Exception as error:  # the loader raises AttributeError, AssertionError, RuntimeError ... on bad content
        reason = _fault_of_file(schema, path) or " ".join(str(error).split()) or type(error).__name__
        raise InvalidFileError(f"{path}: {reason}") from error
    return data


def _fault_of_file(schema: type, path: Path) -> str | None:
    """The first fault in a file that the loader has turned down; None where only the loader knows it."""
    try:
        root = yaml.compose(path.read_text(), Loader=yaml.SafeLoader)
    except (UnicodeDecodeError, yaml.YAMLError):
        return None
    return "is empty." if root is None else _fault(schema, root, "")


def _fault(kind: Any, node: yaml.Node, place: str) -> str | None:
    """The first fault of a node that is to hold a value of a type, with its line; None where there is none to see."""
    options = typing.get_args(kind) if isinstance(kind, types.UnionType) else (kind,)
    if type(None) in options:
        if node.tag == "tag:yaml.org,2002:null":
            return None
        options = tuple(option for option in options if option is not type(None))
    tag = node.tag.removeprefix("!") if node.tag.startswith("!") else None
    if tag is not None and tag not in (names := [option.__name__ for option in options]):
        return f"{_where(node, place)}the tag !{tag} is unknown; allowed are {', '.join(f'!{name}' for name in names)}."
    kind = next((option for option in options if option.__name__ == tag), options[0])
    inside: list[tuple[Any, yaml.Node, str]] = []
    if dataclasses.is_dataclass(kind):
        types_of = typing.get_type_hints(kind)
        if not isinstance(node, yaml.MappingNode):
            return f"{_where(node, place)}is no mapping; its keys may be {', '.join(types_of)}."
        for key, value in node.value:
            if key.tag == "tag:yaml.org,2002:merge":  # `<<` stands for the keys of another mapping
                continue
            name = key.value if isinstance(key, yaml.ScalarNode) else "a list or mapping"
            if name not in types_of:
                return f"{_where(key, place)}key {name!r} is unknown; allowed are {', '.join(types_of)}."
            inside.append((types_of[name], value, f"{place}.{name}".lstrip(".")))
    elif hasattr(kind, "__fields__"):  # one of Drake's own
        if not _is_read_by_drake(kind, node):
            keys = ", ".join(field.name for field in kind.__fields__)
            return f"{_where(node, place)}does not fit Drake's {kind.__name__}; its keys may be {keys}."
    elif typing.get_origin(kind) is list and isinstance(node, yaml.SequenceNode):
        inside = [(typing.get_args(kind)[0], item, f"{place}[{i}]") for i, item in enumerate(node.value)]
    elif typing.get_origin(kind) is dict and isinstance(node, yaml.MappingNode):
        inside = [(typing.get_args(kind)[1], value, f"{place}.{key.value}") for key, value in node.value]
    elif kind in (int, float) and not _is_number(node):
        found = repr(node.value) if isinstance(node, yaml.ScalarNode) else "a list or mapping"
        return f"{_where(node, place)}is {found}; allowed are numbers."
    return next((fault for part in inside if (fault := _fault(*part))), None)


def _where(node: yaml.Node, place: str) -> str:
    return f"line {node.start_mark.line + 1}: " + (f"{place}: " if place else "")


def _is_read_by_drake(kind: type, node: yaml.Node) -> bool:
    try:
        yaml_load_typed(schema=kind, data=yaml.serialize(node))
    except Exception:  # as in `load_typed_yaml`
        return False
    return True


def _is_number(node: yaml.Node) -> bool:
    """Whether the loader would take a node for one: 3, 0x20, and 1e-8, which YAML itself takes for text."""
    if not isinstance(node, yaml.ScalarNode):
        return False
    try:
        float(yaml.safe_load(node.value))
    except (TypeError, ValueError, yaml.YAMLError):
        return False
    return True
