"""The directive `yaml_schema`: every key that a YAML file may hold, read from the dataclasses that it is loaded into.

What a key means is the comment behind or above the field, or the text under `Attributes:` of the class.
"""

import dataclasses
import importlib
import inspect
import re
import types
import typing
from collections.abc import Iterator
from typing import Any

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective


def comments(schema: type) -> dict[str, str]:
    """What the source says of each field: the comment behind or above it, or its entry under `Attributes:`."""
    inherited = [comments(base) for base in schema.__bases__ if dataclasses.is_dataclass(base)]
    found = {name: text for of_base in inherited for name, text in of_base.items()}
    documentation = inspect.getdoc(schema) or ""
    _, _, attributes = documentation.partition("Attributes:\n")
    for name, text in re.findall(r"^    (\w+): (.*?)(?=^    \w|^\S|\Z)", attributes, re.M | re.S):
        found[name] = " ".join(text.split())
    above: list[str] = []
    for line in inspect.getsource(schema).splitlines():
        match = re.match(r"    (\w+): [^#]*(?:  # (.*))?$", line)
        if match and (match[2] or above):
            found[match[1]] = match[2] or " ".join(above)
        above = [*above, line.removeprefix("    # ")] if line.startswith("    # ") else []
    return found


def parts(kind: Any) -> list[type]:
    """The dataclasses that a field's type names: itself, one of a union, or what a list or mapping holds."""
    if dataclasses.is_dataclass(kind) and isinstance(kind, type):
        return [kind]
    return [part for argument in typing.get_args(kind) for part in parts(argument)]


def type_name(kind: Any) -> str:
    """A type, as a reader of YAML would say it."""
    if isinstance(kind, types.UnionType) or typing.get_origin(kind) is typing.Union:
        return " or ".join(type_name(argument) for argument in typing.get_args(kind))
    if kind is type(None):
        return "null"
    if arguments := typing.get_args(kind):
        return f"{typing.get_origin(kind).__name__} of " + ", ".join(type_name(argument) for argument in arguments)
    return getattr(kind, "__name__", str(kind))


def default_of(field: dataclasses.Field[Any]) -> str:
    """A field's default as text; empty where the field holds another schema."""
    if field.default is not dataclasses.MISSING:
        return "null" if field.default is None else str(field.default)
    if field.default_factory is dataclasses.MISSING:
        return "(required)"
    value = field.default_factory()
    return "" if dataclasses.is_dataclass(value) or hasattr(value, "__fields__") else str(value)


def summary(schema: type) -> str:
    """The first line of a class' docstring."""
    return (inspect.getdoc(schema) or "").partition("\n")[0]


def is_ours(schema: type) -> bool:
    """Whether the class is the package's, whose comments can be read."""
    return schema.__module__.startswith("tactopose_drake")


def schemas(root: type) -> Iterator[type]:
    """A schema and all that it is made of, each once."""
    waiting, seen = [root], set()
    while waiting:
        schema = waiting.pop(0)
        if schema in seen or not is_ours(schema):
            continue
        seen.add(schema)
        yield schema
        hints = typing.get_type_hints(schema)
        waiting += [part for field in dataclasses.fields(schema) for part in parts(hints[field.name])]


class YamlSchema(SphinxDirective):
    """A table for each dataclass that the named one is made of."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        """The tables, each under its class' name."""
        module, _, name = self.arguments[0].rpartition(".")
        root = getattr(importlib.import_module(module), name)
        return [self._section(schema) for schema in schemas(root)]

    def _section(self, schema: type) -> nodes.Node:
        section = nodes.section(ids=[f"schema-{schema.__name__.lower()}"])
        section += nodes.title(text=schema.__name__)
        section += nodes.paragraph("", "", *_inline(summary(schema)))
        if not dataclasses.fields(schema):
            return section
        table, group = nodes.table(), nodes.tgroup(cols=4)
        group += [nodes.colspec(colwidth=width) for width in (20, 20, 20, 60)]
        head, body = nodes.thead(), nodes.tbody()
        head += _row(*([nodes.Text(title)] for title in ("key", "type", "default", "what")))
        hints, told = typing.get_type_hints(schema), comments(schema)
        for field in dataclasses.fields(schema):
            kind, default = hints[field.name], default_of(field)
            inner = [part for part in parts(kind) if is_ours(part)]
            what = told.get(field.name) or (summary(inner[0]) if len(inner) == 1 else "")
            body += _row([nodes.literal(text=field.name)], _links(kind), [nodes.Text(default)], _inline(what))
        group += [head, body]
        table += group
        section += table
        return section


def _links(kind: Any) -> list[nodes.Node]:
    """A type's name; or links to the schemas that it is one of."""
    inner = [part for part in parts(kind) if is_ours(part)]
    if not inner:
        return [nodes.Text(type_name(kind))]
    found: list[nodes.Node] = []
    for part in inner:
        found += [nodes.Text(" or ")] if found else []
        found.append(nodes.reference("", part.__name__, refid=f"schema-{part.__name__.lower()}"))
    if (origin := typing.get_origin(kind)) in (list, dict):
        found.insert(0, nodes.Text(f"{origin.__name__} of "))
    return found


def _inline(text: str) -> list[nodes.Node]:
    """Text whose parts between backticks are literals."""
    pieces = text.split("`")
    return [nodes.literal(text=piece) if i % 2 else nodes.Text(piece) for i, piece in enumerate(pieces) if piece]


def _row(*cells: list[nodes.Node]) -> nodes.row:
    row = nodes.row()
    for cell in cells:
        row += nodes.entry("", nodes.paragraph("", "", *cell))
    return row


def setup(app: Sphinx) -> dict[str, Any]:
    """Tells Sphinx of the directive."""
    app.add_directive("yaml_schema", YamlSchema)
    return {"parallel_read_safe": True}
