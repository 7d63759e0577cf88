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
"""

from collections.abc import Iterable


class TactoposeError(Exception):
    """The root of this package's errors."""


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
        super().__init__(f"{what}: {name!r} is unknown; valid names: {', '.join(valid)}.")


class InvalidFileError(InvalidInputError):
    """A file that cannot be read, or whose content does not fit its format."""


class PortTypeError(TactoposeError, TypeError):
    """An input port that is not connected, or that holds a value of another type."""
