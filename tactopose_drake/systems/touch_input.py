"""Reading of the contacts and patches of one instant from input ports."""

from pydrake.systems.framework import Context, InputPort

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.plain_values import counted
from tactopose_drake.core.sensing.patches import Patch
from tactopose_drake.systems.ports import eval_input, eval_items


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


def too_few(touches: int, needed: int) -> str:
    """The status text for too few touches."""
    return f"{counted(touches, 'touch', 'touches')}; {needed} {'is' if needed == 1 else 'are'} needed"
