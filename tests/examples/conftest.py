"""No example opens a door to other machines, whichever test runs it, but those of LCM."""

from collections.abc import Iterator

import pytest

from tests.listening import Watch


@pytest.fixture(scope="module", autouse=True)
def opens_no_door_to_others(request: pytest.FixtureRequest) -> Iterator[None]:
    with Watch() as watch:
        yield
    # LCM's multicast cannot be bound to one machine; with a ttl of 0 what is sent stays on it.
    assert not watch.foreign or request.module.__name__.endswith("test_lcm_latency")
