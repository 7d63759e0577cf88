"""Checks of dataclasses of parameters, each with one clear error that names the parameter and what is allowed."""

import dataclasses
import math
from collections.abc import Collection, Mapping
from types import MappingProxyType
from typing import Any, Protocol, TypeVar

from tactopose_drake.core.validation import instance_of, positive_number, whole_number


class Checked(Protocol):
    """Parameters that say what is wrong with them."""

    def validate(self) -> None:
        """Raises InvalidInputError if a parameter is out of its range."""


Params = TypeVar("Params", bound=Checked)


def params_of(kind: type[Params], value: Params | None) -> Params:
    """Returns parameters that were given, or for None the default ones, which are in their ranges.

    Raises:
        InvalidInputError: a value of another type, or a parameter that is out of its range.
    """
    params = kind() if value is None else value
    instance_of("params", params, kind)
    params.validate()
    return params


def check_parts(params: object, **kinds: type[Checked]) -> None:
    """Checks parameters that are made of others.

    Args:
        params: of all.
        kinds: of what type each part is, by its name.

    Raises:
        InvalidInputError: a part of another type, or a parameter in it that is out of its range.
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
    most: Mapping[str, float] = MappingProxyType({}),
    units: Mapping[str, str] = MappingProxyType({}),
) -> None:
    """Checks the numbers of a dataclass by their defaults: integers from 1 on, and other numbers above 0.

    A field that is None by default is a number where it is not.

    Args:
        name: of the dataclass, for messages.
        params: the dataclass; fields with another default are left aside.
        may_be_zero: names of fields that may be 0, too.
        most: the largest value of a field, by its name.
        units: of such values, where a number may be one of another unit.

    Raises:
        InvalidInputError: a number that is out of its range, or a value that is none.
    """
    for field in dataclasses.fields(params):
        place, value, zero = f"{name}.{field.name}", getattr(params, field.name), field.name in may_be_zero
        if isinstance(field.default, int) and not isinstance(field.default, bool):
            whole_number(place, value, least=0 if zero else 1)
        elif isinstance(field.default, float) or (field.default is None and value is not None):
            largest, unit = most.get(field.name, math.inf), units.get(field.name, "")
            positive_number(place, value, allow_zero=zero, most=largest, unit=unit)
