"""The decisions of hand over and place, with a planner that needs no arm."""

import numpy as np
import pytest
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context
from pydrake.trajectories import PiecewisePolynomial

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.grasping.held_axis import HeldAxis
from tactopose_drake.errors import InvalidInputError
from tactopose_drake.estimation.results import PoseEstimate, PoseHypothesis
from tactopose_drake.station.arms.place_task import PlaceTask, PlaceTaskParams

Q = np.zeros(2)
PARAMS = PlaceTaskParams(settle_time=0.1, patience=0.3, open_time=0.2, tries=2)


class Planner:
    """Goes to 1, on to 2, back to 1; half a second each."""

    num_hand_positions = 3

    def __init__(self, sigma: float = 0.001, reachable: bool = True, meets: bool = True) -> None:
        self.sigma, self.reachable, self.meets = sigma, reachable, meets

    def held_axis(self, estimate: PoseEstimate, contacts: Contacts) -> HeldAxis:
        return HeldAxis(estimate.best.X_PO.translation(), np.array([0.0, 0.0, 1.0]), self.sigma)

    def end_distance(self, held: HeldAxis, before: HeldAxis) -> float:
        return float(np.linalg.norm(held.p_PQ - before.p_PQ))

    def misplacement(self, held: HeldAxis) -> float:
        return float(abs(held.p_PQ[1]))

    def meet(self, q: np.ndarray, q_hand: np.ndarray, held: HeldAxis) -> PiecewisePolynomial | None:
        way = np.array([q, q + 10.0 * held.p_PQ[1]])
        return PiecewisePolynomial.FirstOrderHold([0.0, 0.3], way.T) if self.meets else None

    def plan(self, q: np.ndarray, q_hand: np.ndarray, held: HeldAxis) -> tuple[PiecewisePolynomial, ...] | None:
        ways = [np.array([q, q + 1.0]), np.array([q + 1.0, q + 2.0]), np.array([q + 2.0, q + 1.0])]
        return tuple(PiecewisePolynomial.FirstOrderHold([0.0, 0.5], way.T) for way in ways) if self.reachable else None


def estimate(p_PO: float = 0.0, misplaced: float = 0.0) -> PoseEstimate:
    hypothesis = PoseHypothesis(RigidTransform([p_PO, misplaced, 0.0]), 0.0, 1.0, np.eye(6), np.zeros((0, 6)))
    return PoseEstimate((hypothesis,), "ok", 0.0)


class Bench:
    """A task whose inputs one sets."""

    def __init__(self, planner: Planner) -> None:
        self.task = PlaceTask(planner, Q, PARAMS)  # type: ignore[arg-type]
        self.simulator = Simulator(self.task)
        self.context: Context = self.simulator.get_mutable_context()
        self.set(holding=[0.0], joint_positions=np.zeros(3))
        self.set_object(grasp_status="closing", contacts=touch(2), hypotheses=None)

    def set(self, **values: object) -> None:
        for name, value in values.items():
            self.task.GetInputPort(name).FixValue(self.context, value)

    def set_object(self, **values: object) -> None:
        for name, value in values.items():
            self.task.GetInputPort(name).FixValue(self.context, AbstractValue.Make(value))

    def run(self, duration: float) -> str:
        self.simulator.AdvanceTo(self.context.get_time() + duration)
        return str(self.task.GetOutputPort("phase").Eval(self.context))

    def hold(self, **values: object) -> None:
        self.set(holding=[1.0])
        self.set_object(grasp_status="holding", hypotheses=estimate(), **values)

    @property
    def arm(self) -> np.ndarray:
        return np.array(self.task.GetOutputPort("arm_reference").Eval(self.context))

    @property
    def is_open(self) -> bool:
        return bool(self.task.GetOutputPort("open").Eval(self.context)[0])


def touch(count: int) -> Contacts:
    return Contacts(np.zeros((count, 3))) if count else Contacts.empty()


def test_the_whole_way() -> None:
    bench = Bench(Planner())
    assert bench.run(1.0) == "receive"
    bench.hold()
    assert bench.run(0.05) == "touch"
    assert bench.run(0.11) == "feel"
    assert bench.run(0.15) == "move"
    assert bench.run(0.3) == "move"
    assert 0.4 < bench.arm[0] < 0.9
    assert bench.arm[2] == pytest.approx(2.0)
    assert not bench.is_open
    assert bench.run(0.3) == "insert"
    assert bench.run(0.5) == "release"
    assert bench.is_open
    np.testing.assert_allclose(bench.arm, [2.0, 2.0, 0.0, 0.0], atol=1e-12)
    # The hand has let go: nothing is felt any more, and that is as it should be.
    bench.set_object(contacts=touch(0))
    assert bench.run(0.25) == "retreat"
    assert bench.run(0.6) == "done"
    np.testing.assert_allclose(bench.arm, [1.0, 1.0, 0.0, 0.0], atol=1e-12)


def test_a_rod_that_has_slipped_on_the_way_is_aligned_anew() -> None:
    bench = Bench(Planner())
    bench.hold()
    assert bench.run(0.4) == "move"
    bench.set_object(hypotheses=estimate(0.006))
    assert bench.run(0.5) == "move"  # once more, from where it is
    assert 1.0 < bench.arm[0] < 2.0
    assert bench.run(0.4) == "insert"
    assert bench.arm[0] >= 2.0


def test_the_hand_meets_a_rod_that_does_not_lie_in_it_as_it_should() -> None:
    bench = Bench(Planner())
    bench.hold()
    bench.set_object(hypotheses=estimate(misplaced=0.02))
    assert bench.run(0.15) == "open"
    assert bench.is_open
    np.testing.assert_array_equal(bench.arm, np.zeros(4))  # no motion before the hand is open
    assert bench.run(0.2) == "meet"
    assert bench.is_open
    bench.set(holding=[0.0])
    assert bench.run(0.4) == "receive"
    assert not bench.is_open
    np.testing.assert_allclose(bench.arm, [0.2, 0.2, 0.0, 0.0], atol=1e-12)
    # It lies well now: the grip is taken, and the arm goes on from where it is.
    bench.hold()
    assert bench.run(0.15) == "feel"
    assert bench.run(0.15) == "move"
    assert 0.2 <= bench.arm[0] < 0.6


@pytest.mark.parametrize(
    ("planner", "misplaced"),
    [(Planner(sigma=0.03), 0.02), (Planner(meets=False), 0.02)],
    ids=["felt less exactly than it is misplaced", "out of reach"],
)
def test_a_rod_that_cannot_be_met_is_to_be_offered_anew(planner: Planner, misplaced: float) -> None:
    bench = Bench(planner)
    bench.hold()
    bench.set_object(hypotheses=estimate(misplaced=misplaced))
    assert bench.run(0.15) == "again"


def test_a_grip_that_is_not_firm_is_tried_again_and_then_given_up() -> None:
    bench = Bench(Planner())
    bench.hold()
    bench.set_object(grasp_status="holding; not carrying: thumb")
    assert bench.run(0.05) == "touch"
    assert bench.run(0.1) == "again"
    assert bench.is_open
    bench.set(holding=[0.0])
    assert bench.run(0.25) == "receive"
    assert not bench.is_open
    bench.set(holding=[1.0])
    assert bench.run(0.15) == "failed: no good grip in 2 tries: holding; not carrying: thumb"


def test_a_rod_that_never_lies_well_is_given_up() -> None:
    bench = Bench(Planner())
    bench.hold()
    bench.set_object(hypotheses=estimate(misplaced=0.02))
    assert bench.run(0.4) == "meet"
    bench.set(holding=[0.0])
    assert bench.run(0.4) == "receive"
    bench.set(holding=[1.0])
    assert bench.run(0.2) == "failed: no good grip in 2 tries: the rod's end is 20 mm off its place"
    assert not bench.is_open


def test_nothing_felt_while_handed_over_is_no_grip() -> None:
    bench = Bench(Planner())
    bench.hold(contacts=touch(1))
    assert bench.run(0.15) == "again"
    assert bench.run(0.4) == "failed: no good grip in 2 tries: nothing is felt in the hand"


@pytest.mark.parametrize(
    ("planner", "contacts", "reason"),
    [
        (Planner(sigma=0.02), 2, "ambiguous: the rod's end is known to 20.0 mm only"),
        (Planner(), 1, "nothing is felt in the hand"),
        (Planner(reachable=False), 2, "the arm cannot reach the hole"),
    ],
)
def test_it_says_why_it_does_not_set_off(planner: Planner, contacts: int, reason: str) -> None:
    bench = Bench(planner)
    bench.hold()
    assert bench.run(0.15) == "feel"
    bench.set_object(contacts=touch(contacts))
    assert bench.run(1.0) == f"failed: {reason}"
    np.testing.assert_array_equal(bench.arm, np.zeros(4))
    assert not bench.is_open


@pytest.mark.parametrize(
    ("after", "phase", "reason"), [(0.4, "move", "it is no longer felt"), (1.0, "insert", "its end by 30 mm")]
)
def test_it_stops_where_the_rod_moves_in_the_hand(after: float, phase: str, reason: str) -> None:
    bench = Bench(Planner())
    bench.hold()
    assert bench.run(after) == phase
    if phase == "move":
        bench.set_object(contacts=touch(0))
    else:
        bench.set_object(hypotheses=estimate(0.03))
    assert bench.run(0.05) == f"failed: the rod moved in the hand during {phase!r}: {reason}"
    where = bench.arm[:2]
    assert np.all(where > 0.1)
    bench.run(0.5)
    np.testing.assert_array_equal(bench.arm, [*where, 0.0, 0.0])


def test_what_the_noise_of_the_estimates_explains_is_no_motion() -> None:
    bench = Bench(Planner(sigma=0.004))
    bench.hold()
    bench.run(0.4)
    bench.set_object(hypotheses=estimate(0.02))  # 5 mm + 3 sqrt(2) 4 mm = 22 mm are allowed
    assert bench.run(0.1) == "move"
    bench.set_object(hypotheses=estimate(0.024))
    assert bench.run(0.1).startswith("failed")


def test_a_bad_parameter_is_named() -> None:
    with pytest.raises(InvalidInputError, match=r"PlaceTaskParams\.patience: is -1"):
        PlaceTaskParams(patience=-1.0).validate()
