import dataclasses
import functools

import numpy as np
import pytest

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.evidence.evidence import Evidence
from tactopose_drake.core.plain_values import PlainValue, copied


@dataclasses.dataclass(frozen=True)
class Square:
    side: float
    name: str = ""

    def __post_init__(self) -> None:
        assert self.side > 0.0

    @functools.cached_property
    def area(self) -> float:
        return self.side**2


def test_a_copy_has_other_values_and_nothing_that_was_computed_of_those_before() -> None:
    square = Square(2.0, "a")
    assert square.area == 4.0
    larger = copied(square, side=3.0)
    assert (larger.area, larger.name, square.area) == (9.0, "a", 4.0)
    with pytest.raises(AssertionError, match="sides"):
        copied(square, sides=3.0)


@dataclasses.dataclass(frozen=True, eq=False)
class Timed(PlainValue):
    value: float
    seconds: float = dataclasses.field(default=0.0, compare=False)


def test_what_is_not_compared_is_kept_but_makes_no_difference() -> None:
    slow, fast = Timed(1.0, 2.0), Timed(1.0, 0.5)
    assert slow == fast
    assert hash(slow) == hash(fast)
    assert slow != Timed(2.0, 2.0)
    assert Timed.from_dict(slow.to_dict()).seconds == 2.0


def test_a_touch_of_other_contacts_is_another_touch() -> None:
    evidence = Evidence(Contacts(np.zeros((3, 3))))
    assert len(evidence.touch) == 3
    other = evidence.with_parts(evidence.contacts[:2], None)
    assert len(other.touch) == 2
    assert not other.touch.p_PC.flags.writeable
