import copy
import dataclasses
import functools
import pickle

import numpy as np
import pytest

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.evidence.evidence import Evidence
from tactopose_drake.core.evidence.force_balance import ForceBalance
from tactopose_drake.core.grasping.quality import grasp_quality
from tactopose_drake.core.plain_values import PlainValue, copied
from tactopose_drake.core.sensing.patches import describe_patch
from tactopose_drake.core.sensing.tactile_layout import TactileLayout
from tactopose_drake.core.shape.symmetry import RotationalSymmetry
from tactopose_drake.core.surfaces import Sphere
from tactopose_drake.core.tracking.frame import PoseMeasurement
from tests.core.tracking.boxes import make_box


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


def arrays_in(value: object) -> list[np.ndarray]:
    """All arrays of a value, including what it has cached."""
    if isinstance(value, np.ndarray):
        return [value]
    parts = value if isinstance(value, tuple) else vars(value) if hasattr(value, "__dict__") else value
    parts = parts.values() if isinstance(parts, dict) else parts if isinstance(parts, tuple) else ()
    return [array for part in parts for array in arrays_in(part)]


def make_patch() -> object:
    cells = np.array([[0.003 * i, 0.003 * k, 0.0] for i in range(4) for k in range(3)])
    patch = describe_patch(cells, np.linspace(0.0, 5e3, 12), alpha=1e-7)
    assert patch.points.shape == (12, 3)  # Cached ones are kept in a copy.
    return patch


def make_layout() -> object:
    corners = 0.004 * np.array([[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]]])
    return TactileLayout(corners, np.tile([0.0, 0.0, 1.0], (1, 4, 1)))


def make_model() -> object:
    model = make_box()
    model.make_ready(0.001, 0.02)
    return model


def make_quality() -> object:
    p_PC = np.array([[0.03, 0.0, 0.0], [-0.03, 0.0, 0.0], [0.0, 0.05, 0.0]])
    return grasp_quality(make_box(), Contacts(p_PC), np.eye(3, 4), friction=0.5)


@pytest.mark.parametrize(
    "make",
    [
        make_patch,
        make_layout,
        make_model,
        make_quality,
        lambda: Sphere(radius=0.01),
        lambda: ForceBalance(np.array([0.0, 0.0, -9.81])),
        lambda: RotationalSymmetry(np.array([0.0, 0.0, 1.0]), np.zeros(3), 4),
        lambda: PoseMeasurement(0.0, np.eye(3, 4), np.eye(6)),
    ],
)
@pytest.mark.parametrize("again", [copy.deepcopy, lambda value: pickle.loads(pickle.dumps(value))])
def test_what_is_read_only_is_so_in_every_copy(make, again) -> None:
    value = make()
    own, copied_ones = arrays_in(value), arrays_in(again(value))
    assert own
    assert len(copied_ones) == len(own)
    assert not any(array.flags.writeable for array in copied_ones)


@pytest.mark.parametrize("again", [copy.deepcopy, lambda value: pickle.loads(pickle.dumps(value))])
def test_symmetries_and_balances_are_equal_by_value(again) -> None:
    turn = RotationalSymmetry(np.array([0.0, 0.0, 1.0]), np.zeros(3), 4)
    rest = ForceBalance(np.array([0.0, 0.0, -9.81]))
    for value, other in (
        (turn, RotationalSymmetry(turn.axis, turn.point, 2)),
        (rest, ForceBalance(np.array([0.0, 0.0, -9.8]))),
    ):
        assert again(value) == value == type(value).from_dict(value.to_dict())
        assert hash(again(value)) == hash(value)
        assert other != value
