"""Reading abstract input ports with a check of what they hold, and checks of the names of systems."""

from typing import Any, TypeVar

from pydrake.systems.framework import Context, DiagramBuilder, InputPort

from tactopose_drake.core.validation import instance_of
from tactopose_drake.errors import InvalidInputError, PortTypeError

Kind = TypeVar("Kind")


def check_name_is_free(builder: DiagramBuilder, name: str) -> None:
    """Checks the name of a system that is to be added: Drake ends the process at the builder's `Build` otherwise.

    Args:
        builder: of the diagram.
        name: of the system.

    Raises:
        InvalidInputError: if it is empty or no string, or another system of the builder has it.
    """
    instance_of("builder", builder, DiagramBuilder)
    instance_of("name", name, str)
    if not name:
        raise InvalidInputError("name: is empty; allowed is any other string.")
    if any(system.get_name() == name for system in builder.GetSystems()):
        raise InvalidInputError(
            f"name: is {name!r}, which a system of the builder has already; allowed is another, such as "
            f"name={name + '_2'!r}."
        )


def eval_input(port: InputPort, context: Context, kind: type[Kind]) -> Kind:
    """The value of an abstract input port, checked.

    Drake connects any two ports that carry Python objects, whatever their classes.

    Args:
        port: input port of a system.
        context: that system's context.
        kind: the class that the value must be an instance of.

    Raises:
        PortTypeError: if the port is not connected or holds another type; the message names the port.
    """
    if not port.HasValue(context):
        raise PortTypeError(f"{_name(port)}: is not connected; it needs a {kind.__name__}.")
    return _checked(port, port.Eval(context), kind)


def eval_optional_input(port: InputPort, context: Context, kind: type[Kind]) -> Kind | None:
    """Like `eval_input`, but None when the port is not connected or holds None."""
    if not port.HasValue(context):
        return None
    value = port.Eval(context)
    return None if value is None else _checked(port, value, kind)


def _checked(port: InputPort, value: Any, kind: type[Kind]) -> Kind:
    if not isinstance(value, kind):
        raise PortTypeError(f"{_name(port)}: holds a {type(value).__name__}; allowed is a {kind.__name__}.")
    return value


def _name(port: InputPort) -> str:
    return f"input port {port.get_name()!r} of system {port.get_system().get_name()!r}"
