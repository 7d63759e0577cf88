"""Checks of parameter dataclasses, each with one clear error that names the parameter and what is allowed."""

import dataclasses
import math
from collections.abc import Collection, Mapping
from types import MappingProxyType
from typing import Any, Protocol, TypeVar

from tactopose_drake.core.validation import finite_array, instance_of, positive_number, whole_number


class Checked(Protocol):
    """Parameters that can be validated."""

    def validate(self) -> None:
        """Raises InvalidInputError if a parameter is out of its range."""


Params = TypeVar("Params", bound=Checked)


def params_of(kind: type[Params], value: Params | None) -> Params:
    """Returns the given parameters after validation, or the default ones for None.

    Raises:
        InvalidInputError: a value of another type, or a parameter out of its range.
    """
    params = kind() if value is None else value
    instance_of("params", params, kind)
    params.validate()
    return params


def check_parts(params: object, **kinds: type[Checked]) -> None:
    """Validates parameters that consist of others.

    Args:
        params: the whole.
        kinds: type of each part, by its name.

    Raises:
        InvalidInputError: a part of another type, or a parameter in it out of its range.
    """
    for name, kind in kinds.items():
        part = getattr(params, name)
        instance_of(f"{type(params).__name__}.{name}", part, kind)
        part.validate()


def check_numbers(
    name: str,
    params: Any,
    *,
    may_be_zero: Collection[str] = (),
    any_sign: Collection[str] = (),
    most: Mapping[str, float] = MappingProxyType({}),
    units: Mapping[str, str] = MappingProxyType({}),
) -> None:
    """Checks the numbers of a dataclass, by the type of their defaults: integers from 1 on, and floats above 0.

    A field whose default is None is checked as a float if it is set.

    Args:
        name: of the dataclass, for messages.
        params: the dataclass; fields with other defaults are ignored.
        may_be_zero: names of fields that may also be 0.
        any_sign: names of floats that may be any finite number.
        most: the largest value of a field, by its name.
        units: of such values, to be stated where a number may be in another unit.

    Raises:
        InvalidInputError: a number out of its range, or a value of another type.
    """
    for field in dataclasses.fields(params):
        place, value, zero = f"{name}.{field.name}", getattr(params, field.name), field.name in may_be_zero
        if isinstance(field.default, int) and not isinstance(field.default, bool):
            whole_number(place, value, least=0 if zero else 1)
        elif field.name in any_sign:
            finite_array(place, 0.0 if value is None else value, ())
        elif isinstance(field.default, float) or (field.default is None and value is not None):
            largest, unit = most.get(field.name, math.inf), units.get(field.name, "")
            positive_number(place, value, allow_zero=zero, most=largest, unit=unit)
