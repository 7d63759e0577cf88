"""The decisions of hand over and place, with a planner that needs no arm."""

import dataclasses

import numpy as np
import pytest
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context
from pydrake.trajectories import PiecewisePolynomial

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.evidence.plane_contact import PlaneContact
from tactopose_drake.core.grasping.held_axis import HeldAxis
from tactopose_drake.errors import InvalidInputError
from tactopose_drake.estimation.pose_hypothesis import PoseHypothesis
from tactopose_drake.estimation.results import PoseEstimate
from tactopose_drake.station.arms.place_state import PlaceTaskParams
from tactopose_drake.station.arms.place_task import PlaceTask

Q = np.zeros(2)
PARAMS = PlaceTaskParams(settle_time=0.1, patience=0.3, open_time=0.2, tries=2, pause=0.04, touches=2)
FINGERS = ("first", "second")
X_WP = RigidTransform(RollPitchYaw(0.3, -0.2, 0.5), [0.1, 0.2, 0.4])


class Planner:
    """Goes to 1, on to 2, back to 1, and to the table by 5 and 6; half a second each."""

    num_hand_positions = 3
    p_WTouch = np.array([0.5, 0.0, 0.2])

    def __init__(
        self, sigma: float = 0.001, reachable: bool = True, meets: bool = True, table_reachable: bool = True
    ) -> None:
        self.sigma, self.reachable, self.meets, self.table_reachable = sigma, reachable, meets, table_reachable

    def fingertips(self, q_hand: np.ndarray) -> dict[str, RigidTransform]:
        """All of them as the first joint slides them."""
        return dict.fromkeys(FINGERS, RigidTransform([q_hand[0], 0.0, 0.0]))

    def touch_table(
        self, q: np.ndarray, q_hand: np.ndarray, held: HeldAxis, estimate: PoseEstimate
    ) -> tuple[PiecewisePolynomial, PiecewisePolynomial, np.ndarray] | None:
        above = q + 5.0
        return (way(q, above), way(above, above + 1.0), above) if self.table_reachable else None

    def lift(self, q: np.ndarray, above: np.ndarray) -> PiecewisePolynomial:
        return way(q, above)

    def held_axis(self, estimate: PoseEstimate, contacts: Contacts) -> HeldAxis:
        best, up = estimate.best, float(np.sum([h.probability for h in estimate.hypotheses if h.cost == 0.0]))
        sigma_end = float(np.sqrt(best.covariance[5, 5]))
        return HeldAxis(best.X_PO.translation(), np.array([0.0, 0.0, 1.0]), 0.1, self.sigma, sigma_end, up)

    def end_distance(self, held: HeldAxis, before: HeldAxis) -> float:
        return float(np.linalg.norm(held.p_PQ - before.p_PQ))

    def misplacement(self, held: HeldAxis) -> float:
        return float(abs(held.p_PQ[1]))

    def meet(self, q: np.ndarray, q_hand: np.ndarray, held: HeldAxis) -> PiecewisePolynomial | None:
        way = np.array([q, q + 10.0 * held.p_PQ[1]])
        return PiecewisePolynomial.FirstOrderHold([0.0, 0.3], way.T) if self.meets else None

    def plan(self, q: np.ndarray, q_hand: np.ndarray, held: HeldAxis) -> tuple[PiecewisePolynomial, ...] | None:
        return (way(q, q + 1.0), way(q + 1.0, q + 2.0), way(q + 2.0, q + 1.0)) if self.reachable else None


def way(q: np.ndarray, q_end: np.ndarray) -> PiecewisePolynomial:
    return PiecewisePolynomial.FirstOrderHold([0.0, 0.5], np.array([q, q_end]).T)


def estimate(p_PO: float = 0.0, misplaced: float = 0.0, sigma_end: float = 0.001, up: float = 1.0) -> PoseEstimate:
    """Two hypotheses, of either end up."""
    X_PO, covariance = RigidTransform([p_PO, misplaced, 0.0]), np.diag([1.0, 1.0, 1.0, 1.0, 1.0, sigma_end**2])
    either = [
        PoseHypothesis(X_PO, cost, share, covariance, np.zeros((0, 6))) for cost, share in ((0.0, up), (1.0, 1.0 - up))
    ]
    return PoseEstimate(tuple(either), "ok", 0.0)


class Bench:
    """A task whose inputs one sets."""

    def __init__(self, planner: Planner) -> None:
        self.task = PlaceTask(planner, Q, PARAMS)  # type: ignore[arg-type]
        self.simulator = Simulator(self.task)
        self.context: Context = self.simulator.get_mutable_context()
        self.set(holding=[0.0], joint_positions=np.zeros(3))
        self.set_object(grasp_status="closing", contacts=touch(2), hypotheses=None)
        self.set_object(fingers_in_contact=FINGERS, palm_pose=X_WP)

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
        self.set_object(**{"grasp_status": "holding", "hypotheses": estimate()} | values)

    @property
    def planes(self) -> tuple[PlaneContact, ...]:
        planes: tuple[PlaneContact, ...] = self.task.GetOutputPort("planes").Eval(self.context)
        return planes

    @property
    def arm(self) -> np.ndarray:
        return np.array(self.task.GetOutputPort("arm_reference").Eval(self.context))

    @property
    def is_open(self) -> bool:
        return bool(self.task.GetOutputPort("open").Eval(self.context)[0])


def touch(count: int, pressed: float = -0.05) -> Contacts:
    """Contacts whose forces on the hand are its weight at the rod, or more, along the world's z axis."""
    p_PC = np.linspace([0.0, 0.0, -0.03], [0.0, 0.01, 0.03], count)
    f_PC = X_WP.rotation().inverse().multiply(np.array([0.0, 0.0, pressed / count])) if count else np.zeros(3)
    return Contacts(p_PC, f_PC=np.tile(f_PC, (count, 1))) if count else Contacts.empty()


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


def test_a_simulator_that_copies_its_state_copies_no_motions() -> None:
    """Each event that may change any state, a sensor's sample too, has all state copied."""
    bench = Bench(Planner())
    bench.hold()
    assert bench.run(0.4) == "move"
    assert bench.task.state(bench.context.Clone()) is bench.task.state(bench.context)


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


def test_no_motion_is_planned_from_a_pose_that_does_not_explain_the_touch() -> None:
    unexplained = dataclasses.replace(estimate(misplaced=0.02), status="no_solution")
    bench = Bench(Planner())
    bench.hold(hypotheses=unexplained)
    assert bench.run(0.15) == "again"
    bench = Bench(Planner())
    bench.hold()
    assert bench.run(0.15) == "feel"
    bench.set_object(hypotheses=dataclasses.replace(estimate(), status="no_solution"))
    assert bench.run(1.0) == "failed: no pose of the rod explains the touch"
    np.testing.assert_array_equal(bench.arm, np.zeros(4))
    bench = Bench(Planner())
    bench.hold()
    assert bench.run(0.4) == "move"
    bench.set_object(hypotheses=dataclasses.replace(estimate(0.006), status="no_solution"))
    assert bench.run(0.5) == "insert"


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
        (Planner(sigma=0.02), 2, "ambiguous: the rod's end is known to 20.0 mm across and 1.0 mm along it only"),
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
    with pytest.raises(InvalidInputError, match=r"PlaceTaskParams\.patience must be .*, not -1"):
        PlaceTaskParams(patience=-1.0).validate()


def test_the_table_is_touched_until_slide_and_end_are_known() -> None:
    bench = Bench(Planner())
    bench.hold(hypotheses=estimate(sigma_end=0.03, up=0.5))
    assert bench.run(0.15) == "feel"
    assert bench.run(0.15) == "approach"
    assert bench.run(0.42) == "approach"  # over the table, until nothing shakes any more
    assert bench.arm[0] == pytest.approx(5.0)
    assert bench.run(0.06) == "lower"
    assert bench.planes == ()
    bench.set_object(contacts=touch(2, pressed=0.04))  # less than what counts as the table, above the weight
    assert bench.run(0.1) == "lower"
    assert 5.0 < bench.arm[0] < 5.6
    bench.set_object(contacts=touch(2, pressed=0.06))
    assert bench.run(0.04) == "lift"
    (plane,) = bench.planes
    np.testing.assert_allclose(X_WP.rotation().multiply(plane.n_P), [0.0, 0.0, 1.0], atol=1e-12)
    assert X_WP.multiply(plane.p_PQ)[2] == pytest.approx(0.2)
    # What the fingers hold goes with them, and so does the table that it touched.
    bench.set(joint_positions=[0.001, 0.0, 0.0])
    (moved,) = bench.planes
    np.testing.assert_allclose(moved.n_P, plane.n_P, atol=1e-3)
    middle, shift = touch(2).p_PC.mean(axis=0), np.array([0.001, 0.0, 0.0])
    height = (middle - plane.p_PQ) @ plane.n_P
    assert (middle + shift - moved.p_PQ) @ moved.n_P == pytest.approx(height, abs=2e-5)
    assert abs((middle + shift - plane.p_PQ) @ plane.n_P - height) > 1e-4

    bench.set_object(contacts=touch(2), hypotheses=estimate(up=0.9))
    assert bench.run(0.5) == "feel"
    assert bench.arm[0] == pytest.approx(5.0)
    assert bench.run(0.15) == "approach"  # the slide is known, the end is not yet
    assert bench.run(0.6) == "lower"
    bench.set_object(contacts=touch(2, pressed=0.5))
    assert bench.run(0.04) == "lift"
    assert len(bench.planes) == 2
    bench.set_object(contacts=touch(2), hypotheses=estimate(up=0.9))
    bench.run(0.5)
    assert bench.run(0.15) == "move"  # of two touches no third is made
    bench.run(1.0)
    assert bench.run(0.1) == "release"
    assert bench.planes == ()


@pytest.mark.parametrize(
    ("planner", "waits", "reason"),
    [
        (Planner(table_reachable=False), 0.3, "the arm cannot reach the table"),
        (Planner(), 1.5, "the rod does not reach the table"),
    ],
)
def test_it_says_why_it_does_not_touch_the_table(planner: Planner, waits: float, reason: str) -> None:
    bench = Bench(planner)
    bench.hold(hypotheses=estimate(sigma_end=0.03, up=0.5))
    assert bench.run(waits) == f"failed: {reason}"


def test_a_finger_whose_sensor_fails_is_no_touch_of_the_table() -> None:
    bench = Bench(Planner())
    three, fingers = touch(3, pressed=-0.75), (*FINGERS, "third")
    bench.hold(hypotheses=estimate(sigma_end=0.03, up=0.5), contacts=three, fingers_in_contact=fingers)
    while bench.run(0.02) != "lower":
        pass
    bench.set_object(contacts=three[:2], fingers_in_contact=FINGERS)
    assert bench.run(0.1) == "lower"
    bench.set_object(contacts=touch(3, pressed=-0.5), fingers_in_contact=fingers)
    assert bench.run(0.04) == "lift"


def test_without_its_slide_the_rod_is_not_taken_to_the_hole() -> None:
    bench = Bench(Planner())
    bench.hold(hypotheses=estimate(sigma_end=0.03))
    for _ in range(2):
        bench.set_object(contacts=touch(2))
        while bench.run(0.02) != "lower":
            pass
        bench.set_object(contacts=touch(2, pressed=0.5))
        assert bench.run(0.04) == "lift"
    reason = "ambiguous: the rod's end is known to 1.0 mm across and 30.0 mm along it only"
    assert bench.run(1.2) == f"failed: {reason}"
