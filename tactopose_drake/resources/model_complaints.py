"""What Drake logs while it reads a model, told apart by what it is about and not by the line that it is about."""

import re

# "/path/model.urdf:68: warning: A joint has ..."
_PLACE = re.compile(r"^(?P<file>[^\n]*?):\d+: (?P<rest>(warning|error): .*)", re.DOTALL)


def complaint_kind(message: str) -> str:
    """A message without the line in the model's file, and then without what follows on its first line of text.

    Messages of the same kind differ in their places and in numbers. One that names no place is its own kind.
    """
    found = _PLACE.match(message)
    if found is None:
        return message
    return f"{found['file']}: {found['rest'].splitlines()[0]}"
