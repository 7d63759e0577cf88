"""Messages that Drake logs while it parses a model, grouped by kind, regardless of the line in the file."""

import re

# "/path/model.urdf:68: warning: A joint has ..."
_PLACE = re.compile(r"^(?P<file>[^\n]*?):\d+: (?P<rest>(warning|error): .*)", re.DOTALL)


def complaint_kind(message: str) -> str:
    """The kind of a message: its file and the first line of its text, without the line number.

    Messages of the same kind differ in their places and in numbers. One without a place is its own kind.
    """
    found = _PLACE.match(message)
    if found is None:
        return message
    return f"{found['file']}: {found['rest'].splitlines()[0]}"
