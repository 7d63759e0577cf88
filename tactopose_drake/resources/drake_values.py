"""Values of Drake's schema within dataclasses: equal by value, and pickled, for which Drake has nothing."""

import copyreg
import dataclasses
from typing import Any

from pydrake.common.schema import Transform
from pydrake.common.yaml import yaml_dump_typed, yaml_load_typed
from pydrake.multibody.plant import MultibodyPlantConfig

_KINDS = (Transform, MultibodyPlantConfig)


class WithDrakeValues:
    """Base of dataclasses with a `Transform` or `MultibodyPlantConfig`, which Drake does not compare by value."""

    __slots__ = ()

    def __eq__(self, other: object) -> bool:
        if type(self) is not type(other):
            return NotImplemented
        names = [field.name for field in dataclasses.fields(self)]  # type: ignore[arg-type]
        return all(_comparable(getattr(self, name)) == _comparable(getattr(other, name)) for name in names)


def _comparable(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _comparable(item) for key, item in value.items()}
    return yaml_dump_typed(value) if isinstance(value, _KINDS) else value


def _reduced(value: Any) -> tuple[Any, ...]:
    return _read, (type(value), yaml_dump_typed(value))


def _read(kind: type, text: str) -> Any:
    return yaml_load_typed(schema=kind, data=text)


for _kind in _KINDS:
    copyreg.pickle(_kind, _reduced)
