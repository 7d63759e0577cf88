"""Reading abstract input ports with a check of what they hold."""

from typing import Any, TypeVar

from pydrake.systems.framework import Context, InputPort

from tactopose_drake.errors import PortTypeError

Kind = TypeVar("Kind")


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
