"""General limits of all numbers in a scenario."""

import dataclasses
from typing import Any

from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlantConfig

from tactopose_drake.core.validation import known_name, limited, positive_number, whole_number
from tactopose_drake.errors import InvalidInputError
from tactopose_drake.resources import passing_builder

_SHORTEST = 1e-5  # shortest period, s; a simulation with shorter ones would hardly advance
_LARGEST = 1e12  # largest number, in SI units; squares and products of larger ones overflow
_MOST = 1_000_000  # largest integer
_LONGEST_STEP = 0.1  # longest time step of the simulator, s; contact is not solved with longer ones


def check_limits(name: str, value: Any) -> None:
    """Checks all numbers in a part of a scenario.

    Args:
        name: name of the part, for messages.
        value: a dataclass, list, dict or number; values of other types have no limits.

    Raises:
        InvalidInputError: if a number is beyond its limit.
    """
    if isinstance(value, dict):
        for key, item in value.items():
            check_limits(f"{name}[{key}]", item)
    elif isinstance(value, list):
        for i, item in enumerate(value):
            check_limits(f"{name}[{i}]", item)
    elif dataclasses.is_dataclass(value):
        for field in dataclasses.fields(value):
            check_limits(f"{name}.{field.name}", getattr(value, field.name))
    elif isinstance(value, float | int) and not isinstance(value, bool):
        last = name.rpartition(".")[2]
        if last == "seed":
            whole_number(name, value, least=0, most=2**63 - 1)
        elif last == "period":
            positive_number(name, value, least=_SHORTEST, most=_LARGEST)
        elif isinstance(value, int):
            whole_number(name, value, least=-_MOST, most=_MOST)
        else:
            limited(name, value, (), most=_LARGEST)


def check_plant(name: str, config: MultibodyPlantConfig) -> None:
    """Raises InvalidInputError if the simulator would not accept its configuration."""
    positive_number(f"{name}.time_step", config.time_step, least=_SHORTEST, most=_LONGEST_STEP)
    for key in ("penetration_allowance", "stiction_tolerance", "sap_near_rigid_threshold"):
        allow_zero = key == "sap_near_rigid_threshold"
        check_limits(f"{name}.{key}", positive_number(f"{name}.{key}", getattr(config, key), allow_zero=allow_zero))
    for key, allowed in _PLANT_CHOICES.items():
        known_name(f"{name}.{key}", getattr(config, key), allowed)
    try:
        with passing_builder() as builder:
            AddMultibodyPlant(config=config, builder=builder)
    except RuntimeError as error:
        raise InvalidInputError(f"{name}: {' '.join(str(error).split())}") from None


_PLANT_CHOICES = {
    "contact_model": ("point", "hydroelastic", "hydroelastic_with_fallback"),
    "discrete_contact_approximation": ("tamsi", "sap", "similar", "lagged"),
    "contact_surface_representation": ("triangle", "polygon"),
}
