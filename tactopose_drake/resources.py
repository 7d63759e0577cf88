"""Where models and diagrams are found, how `package://` URLs resolve, and YAML files read into dataclasses."""

import dataclasses
import types
import typing
from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path
from typing import Any, TypeVar

import yaml
from pydrake.common.yaml import yaml_load_typed
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex

from tactopose_drake.errors import InvalidFileError, InvalidInputError

Schema = TypeVar("Schema")


def resource_root() -> Path:
    """The folder that holds `models/` and `diagrams/`: the package itself when installed, the checkout otherwise."""
    package = Path(__file__).resolve().parent
    return package if (package / "models").is_dir() else package.parent


def model_path(*parts: str) -> Path:
    """The path of a shipped model, e.g. `model_path("objects", "mug.obj")`."""
    return resource_root().joinpath("models", *parts)


@dataclasses.dataclass(kw_only=True, slots=True)
class ModelPackage:
    """A package of models that a Python distribution has installed."""

    name: str = ""  # what `package://<name>/...` calls it in the model's files
    distribution: str = ""  # the distribution that brings it, as pip names it
    folder: str = ""  # its root among the distribution's files

    def path(self) -> Path:
        """Its root.

        Raises:
            InvalidInputError: if the distribution is not installed, or has no such folder.
        """
        try:
            root = Path(str(distribution(self.distribution).locate_file(self.folder)))
        except (PackageNotFoundError, ValueError) as error:
            raise InvalidInputError(
                f"package {self.name!r}: the distribution {self.distribution!r} is not installed; "
                f"`pip install {self.distribution}` brings it."
            ) from error
        if not root.is_dir():
            raise InvalidInputError(f"package {self.name!r}: {self.distribution!r} has no folder {self.folder!r}.")
        return root


def make_parser(plant: MultibodyPlant, packages: Sequence[ModelPackage] = ()) -> Parser:
    """A parser that resolves `package://tactopose_drake/...`, what ROS_PACKAGE_PATH leads to, and the given packages.

    Raises:
        InvalidInputError: if a package is not installed.
    """
    parser = Parser(plant)
    parser.package_map().PopulateFromRosPackagePath()
    parser.package_map().Add("tactopose_drake", str(resource_root()))
    for package in packages:
        parser.package_map().Add(package.name, str(package.path()))
    return parser


def add_model(parser: Parser, model: str | Path) -> ModelInstanceIndex:
    """Parses a file that holds one model: an SDF, URDF or MJCF, by path or by URL.

    Raises:
        InvalidFileError: if Drake cannot read the file, or it does not hold exactly one model.
    """
    try:
        instances = parser.AddModels(url=model) if "://" in str(model) else parser.AddModels(str(model))
    except RuntimeError as error:
        raise InvalidFileError(f"{model}: is no model that Drake can read ({' '.join(str(error).split())}).") from None
    if len(instances) != 1:
        raise InvalidFileError(f"{model}: holds {len(instances)} models; allowed is one.")
    return instances[0]


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
