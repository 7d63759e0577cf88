"""What a target of the fuzzer is: a public call with arguments as data, so that they can be corrupted before it."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

Arguments = dict[str, Any]
"""Arguments by name; a value may itself be arguments, of what is made first and then passed."""


class Target(NamedTuple):
    """A public call.

    Attributes:
        arguments: draws plausible ones; plain data (arrays, numbers, strings, dictionaries and lists of them) as far as
            the call's own arguments are.
        call: makes the call and asserts that the answer is what its status says.
        weight: how often it is called, in proportion to others.
    """

    arguments: Callable[[np.random.Generator], Arguments]
    call: Callable[[Arguments], None]
    weight: float = 1.0


def build(make: Callable[..., Any], arguments: Any) -> Any:
    """What `make` makes of arguments that are a dictionary; another value is passed on as it is."""
    return make(**arguments) if isinstance(arguments, dict) and arguments else arguments
