"""Where work is done beside this thread."""

import contextlib
from collections.abc import Iterator

from tactopose_drake.errors import InvalidInputError


@contextlib.contextmanager
def handing_over() -> Iterator[None]:
    """What is handed over to an executor inside of this, it takes.

    Raises:
        InvalidInputError: if it does not: it is shut down, or its workers have died.
    """
    try:
        yield
    except RuntimeError as error:
        raise InvalidInputError(f"executor: takes no work ({error}); allowed is one that is open.") from None
