"""The errors of the package, all of them.

Each leaf is also the built-in error that it is a case of, so code that knows nothing of this package can handle it.

    TactoposeError
    +-- InvalidInputError (ValueError)     a value that cannot be used: its name, the value, and what is allowed
    |   +-- InvalidMeshError               a mesh that is empty, flat, not manifold, or without an inside
    |   +-- MeshUnitsError                 a mesh that is evidently not in metres
    |   +-- TooFewContactsError            fewer contacts than the method needs
    |   +-- UnknownNameError               a name (method, surface, finger) that is not one of those that exist
    |   +-- InvalidFileError               a file that cannot be read, or whose content does not fit its format
    +-- PortTypeError (TypeError)          an input port that holds a value of another type, or nothing
    +-- DriverError                        a sensor, or the bus that it is on
        +-- BusError (OSError)             a CAN bus that cannot be opened, or that fails
        +-- ProtocolError (ValueError)     a frame that does not fit its protocol, or holds a value out of range
        +-- DeviceTimeoutError (TimeoutError)  a device that does not answer in time
        +-- DeviceError (RuntimeError)     a device that answers, but cannot be used as it is
        +-- EndOfLogError (EOFError)       a log that has been played to its end
"""

from collections.abc import Iterable
from typing import Any

_LONG, _BEGINNING = 80, 60  # characters: length from which a value is abbreviated, and what is kept of a long string


def shown(value: object) -> str:
    """A value as error messages show it, in one line: its repr; if that is long, a string's beginning or the type."""
    try:
        text = " ".join(line.strip() for line in repr(value).splitlines())
    except ValueError:  # Python refuses to print integers of thousands of digits.
        return kind_name(type(value))
    if len(text) < _LONG:
        return text
    return f"{text[:_BEGINNING]}..." if isinstance(value, str) else kind_name(type(value))


def kind_name(kind: type) -> str:
    """A type as error messages name it: "a Patch", "an int", or "None"."""
    if kind is type(None):
        return "None"
    return f"{'an' if kind.__name__[0] in 'AEIOaeio' or kind.__name__ == 'ndarray' else 'a'} {kind.__name__}"


class TactoposeError(Exception):
    """The root of this package's errors."""

    def __reduce__(self) -> tuple[Any, ...]:
        # Restored from its message, not by calling the constructor, whose arguments differ between subclasses: this
        # keeps an error that another process raised intact.
        return _remade, (type(self), self.args), vars(self)


def _remade(kind: type[TactoposeError], args: tuple[Any, ...]) -> TactoposeError:
    error = kind.__new__(kind, *args)
    error.args = args
    return error


class InvalidInputError(TactoposeError, ValueError):
    """A value that cannot be used; the message says its name, the value, and what is allowed."""


class InvalidMeshError(InvalidInputError):
    """A mesh that is empty, flat, not manifold, or has no inside."""


class MeshUnitsError(InvalidInputError):
    """A mesh that is evidently not in metres."""


class TooFewContactsError(InvalidInputError):
    """Fewer contacts than the method needs."""


class UnknownNameError(InvalidInputError):
    """A name that is not one of those that exist."""

    def __init__(self, what: str, name: object, valid: Iterable[str]) -> None:
        names = ", ".join(valid)
        allowed = f"one of {names}" if names else "left out, as there is nothing that it could name"
        super().__init__(f"{what} must be {allowed}, not {shown(name)}.")


class InvalidFileError(InvalidInputError):
    """A file that cannot be read, or whose content does not fit its format."""


class PortTypeError(TactoposeError, TypeError):
    """An input port that is not connected, or that holds a value of another type."""


class DriverError(TactoposeError):
    """The root of the errors of sensors and their buses."""


class BusError(DriverError, OSError):
    """A CAN bus that cannot be opened, or that fails."""


class ProtocolError(DriverError, ValueError):
    """A frame that does not fit its protocol, or that holds a value out of range."""


class DeviceTimeoutError(DriverError, TimeoutError):
    """A device that does not answer in time."""


class DeviceError(DriverError, RuntimeError):
    """A device that answers, but cannot be used as it is."""


class EndOfLogError(DriverError, EOFError):
    """A log that has been played to its end; the message says whether it was cut off.

    Attributes:
        whole: False if the log was cut off.
    """

    def __init__(self, message: str, *, whole: bool = True) -> None:
        super().__init__(message)
        self.whole = whole
