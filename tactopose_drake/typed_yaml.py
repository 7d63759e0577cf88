"""Reading a YAML file into a dataclass, with one clear error when that fails."""

from pathlib import Path
from typing import TypeVar

from pydrake.common.yaml import yaml_load_typed

from tactopose_drake.errors import InvalidFileError

Schema = TypeVar("Schema")


def load_typed_yaml(schema: type[Schema], path: Path) -> Schema:
    """Reads a YAML file into an instance of a dataclass; unknown keys are errors, absent keys keep their defaults.

    Ranges are not checked here: `yaml_load_typed` bypasses `__post_init__`, so the schema's `validate` does it.

    Raises:
        InvalidFileError: if the file cannot be read or does not fit the schema; the message is one line that names the
            file.
    """
    try:
        data: Schema = yaml_load_typed(schema=schema, filename=str(path))
    except Exception as error:  # the loader raises AttributeError, AssertionError, RuntimeError ... on bad content
        reason = " ".join(str(error).split()) or type(error).__name__
        raise InvalidFileError(f"{path}: {reason}") from error
    return data
