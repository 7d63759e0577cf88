"""No example opens a door to other machines, whichever test runs it."""

from collections.abc import Iterator

import pytest

from tests.listening import Watch


@pytest.fixture(scope="module", autouse=True)
def opens_no_door_to_others() -> Iterator[None]:
    with Watch() as watch:
        yield
    assert not watch.foreign
