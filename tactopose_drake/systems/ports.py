"""Type-checked reading of input ports, export of output ports, and checks of systems' names."""

from collections.abc import Iterable, Mapping
from typing import Any, TypeVar

from pydrake.systems.framework import Context, DiagramBuilder, InputPort, OutputPort, System

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.plain_values import counted
from tactopose_drake.core.sensing.patches import Patch
from tactopose_drake.core.validation import instance_of, kind_name
from tactopose_drake.errors import InvalidInputError, PortTypeError

Kind = TypeVar("Kind")


def export_outputs(builder: DiagramBuilder, system: System, prefix: str = "") -> None:
    """Exports all output ports of a system, by their names after a prefix."""
    for port in map(system.get_output_port, range(system.num_output_ports())):
        builder.ExportOutput(port, f"{prefix}{port.get_name()}")


def connect_known(builder: DiagramBuilder, ports: Mapping[str, OutputPort], system: System) -> None:
    """Connects ports to those inputs of a system that have their names."""
    for name, port in ports.items():
        if system.HasInputPort(name):
            builder.Connect(port, system.GetInputPort(name))


def check_name_is_free(builder: DiagramBuilder, name: str, others: Iterable[str] = ()) -> None:
    """Checks the name of a system before it is added: Drake aborts the process in `Build` if it is empty or taken.

    Args:
        builder: the diagram's builder.
        name: name of the system.
        others: what follows the name and an underscore in the names of the systems that are added with it.

    Raises:
        InvalidInputError: if the name is empty or no string, or another system of the builder has it, or one of those
            of the systems that are added with it.
    """
    instance_of("builder", builder, DiagramBuilder)
    instance_of("name", name, str)
    if not name:
        raise InvalidInputError("name must not be empty.")
    taken = {system.get_name() for system in builder.GetSystems()}
    if name in taken:
        raise InvalidInputError(
            f"name must be one that no other system of the builder has, such as {name + '_2'!r}, not {name!r}."
        )
    if clash := sorted(taken & {f"{name}_{other}" for other in others}):
        raise InvalidInputError(
            f"name must be one such as {name + '_2'!r}, not {name!r}, as another system of the builder is called "
            f"{clash[0]!r}, as one that is added would be."
        )


def eval_input(port: InputPort, context: Context, kind: type[Kind]) -> Kind:
    """The value of an abstract input port, with a check of its type.

    The check is needed because Drake connects any two ports that carry Python objects, whatever their classes.

    Args:
        port: input port of a system.
        context: that system's context.
        kind: the class that the value must be an instance of.

    Raises:
        PortTypeError: if the port is not connected or holds another type; the message names the port.
    """
    if not port.HasValue(context):
        raise PortTypeError(f"{port_name(port)} must hold {kind_name(kind)}, but is not connected.")
    return _checked(port, port.Eval(context), kind)


def eval_optional_input(port: InputPort, context: Context, kind: type[Kind]) -> Kind | None:
    """Like `eval_input`, but None when the port is not connected or holds None."""
    if not port.HasValue(context):
        return None
    value = port.Eval(context)
    return None if value is None else _checked(port, value, kind)


def eval_items(port: InputPort, context: Context, kind: type[Kind]) -> tuple[Kind, ...]:
    """The tuple that an abstract input port holds, its items checked; empty if it is not connected or holds None.

    Args:
        port: input port of a system.
        context: that system's context.
        kind: the class that each item must be an instance of.

    Raises:
        PortTypeError: if the port holds anything else; the message names the port.
    """
    items: tuple[Kind, ...] = eval_optional_input(port, context, tuple) or ()
    _check_items(port, "tuple", items, kind)
    return items


def eval_named(port: InputPort, context: Context, kind: type[Kind]) -> dict[str, Kind]:
    """The dictionary that an abstract input port holds, its values checked like the items of `eval_items`."""
    named: dict[str, Kind] = eval_input(port, context, dict)
    _check_items(port, "dict", named.values(), kind)
    return named


def eval_touch(contacts: InputPort, patches: InputPort, context: Context) -> tuple[Contacts, tuple[Patch, ...]]:
    """Reads contacts and patches; one of the two ports may stay unconnected.

    Args:
        contacts: input port of a system.
        patches: likewise.
        context: that system's context.

    Raises:
        PortTypeError: if neither is connected, or one holds a wrong type; the message names the port.
    """
    felt = eval_items(patches, context, Patch)
    if contacts.HasValue(context) or not patches.HasValue(context):
        return eval_input(contacts, context, Contacts), felt
    return Contacts.empty(), felt


def eval_fingers(contacts: InputPort, fingers: InputPort, context: Context) -> tuple[Contacts, tuple[str, ...]]:
    """Reads contacts and the names of the fingers that make them.

    Args:
        contacts: input port of a system.
        fingers: likewise.
        context: that system's context.

    Raises:
        PortTypeError: if one is not connected or holds a wrong type, or there are not as many different names as
            contacts; the message names the port.
    """
    felt, names = eval_input(contacts, context, Contacts), eval_input(fingers, context, tuple)
    check_names(fingers, names, len(felt), "contacts")
    return felt, names


def check_names(port: InputPort, names: tuple[Any, ...], count: int, touches: str) -> None:
    """Raises PortTypeError, by the port's name, unless these are as many different names as touches of a kind."""
    if not all(isinstance(name, str) for name in names) or len(names) != count or len({*names}) != count:
        raise PortTypeError(
            f"{port_name(port)} must hold as many different names as there are {touches}, {count}, not {names!r}."
        )


def eval_touch_remarks(statuses: Iterable[InputPort], context: Context) -> list[str]:
    """What the connected ports `contact_status` and `patch_status` hold besides "ok"."""
    remarks = (eval_optional_input(port, context, str) for port in statuses)
    return [remark for remark in remarks if remark is not None and remark != "ok"]


def too_few(touches: int, needed: int) -> str:
    """The status text for too few touches."""
    return f"{counted(touches, 'touch', 'touches')}; {needed} {'is' if needed == 1 else 'are'} needed"


def port_name(port: InputPort) -> str:
    """The name of an input port in error messages."""
    return f"input port {port.get_name()!r} of system {port.get_system().get_name()!r}"


def _check_items(port: InputPort, container: str, items: Iterable[Any], kind: type[Any]) -> None:
    for item in items:
        if not isinstance(item, kind):
            raise PortTypeError(
                f"{port_name(port)} must hold a {container} of {kind.__name__}, not one with {kind_name(type(item))}."
            )


def _checked(port: InputPort, value: Any, kind: type[Kind]) -> Kind:
    if not isinstance(value, kind):
        raise PortTypeError(f"{port_name(port)} must hold {kind_name(kind)}, not {kind_name(type(value))}.")
    return value
