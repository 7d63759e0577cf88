"""The explorer alone, with a hand whose fingers follow its commands at once, and contacts that a test makes."""

import functools

import numpy as np
import pytest
from pydrake.common.value import AbstractValue
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.analysis import Simulator

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.errors import InvalidInputError, PortTypeError
from tactopose_drake.hand.hand_config import load_hand_config
from tactopose_drake.hand.hand_in_plant import Hand, make_hand_plant
from tactopose_drake.hand.hand_joints import HandJoints
from tactopose_drake.hand.hand_reach import rest_posture
from tactopose_drake.systems.next_touch_chooser import GuardedMove
from tactopose_drake.systems.touch_explorer import TouchExplorer, TouchExplorerParams

PARAMS = TouchExplorerParams(speed=2.0, settle_time=0.1, press_time=0.05, most_touches=2)
ALONG_X, ALONG_Z = np.array([[1.0, 0.0, 0.0]]), np.array([[0.0, 0.0, 1.0]])
HELD = Contacts(np.array([[0.03, 0.0, 0.1], [0.0, 0.04, 0.1]]), np.tile(ALONG_X, (2, 1)), np.tile(ALONG_X, (2, 1)))
FELT = Contacts(np.array([[0.05, 0.02, 0.09]]), ALONG_Z, 0.4 * ALONG_Z)
FAINT = Contacts(FELT.p_PC, ALONG_Z, 0.1 * ALONG_Z)
NAMES = ("thumb", "first")


@functools.cache
def explorer_and_hand() -> tuple[TouchExplorer, MultibodyPlant, Hand]:
    """An explorer, all of whose changes stand in a context, and the hand that it moves."""
    config = load_hand_config("shadow_like")
    return TouchExplorer(config, PARAMS), *make_hand_plant(config)


class Bench:
    def __init__(self) -> None:
        self.explorer, plant, hand = explorer_and_hand()
        self.q_rest = rest_posture(plant, hand)
        self.joints = tuple(hand.config.finger("ring").joints)
        self.places = HandJoints.of(plant, hand).positions(self.joints)
        self.simulator = Simulator(self.explorer)
        self.context = self.simulator.get_mutable_context()
        self.follows = True
        self.set("holding", [0.0])
        self.set("joint_positions", self.q_rest)
        self.touch(False)
        self.offer(None)

    def set(self, name: str, value: object) -> None:
        port = self.explorer.GetInputPort(name)
        port.FixValue(self.context, value if isinstance(value, list | np.ndarray) else AbstractValue.Make(value))

    def touch(self, is_felt: bool, felt: Contacts = FELT) -> None:
        """The holding fingers' contacts, and that of the exploring one or not."""
        self.set("contacts", HELD.joined(felt) if is_felt else HELD)
        self.set("fingers_in_contact", (*NAMES, "ring") if is_felt else NAMES)

    def offer(self, goal: float | None, time: float | None = None) -> None:
        if goal is None:
            self.set("next_touch", None)
            return
        start = self.q_rest[self.places]
        time = self.context.get_time() if time is None else time
        self.set("next_touch", GuardedMove("ring", self.joints, start, start + goal, 1.0, 2.0, time))

    def run(self, duration: float) -> None:
        until = self.context.get_time() + duration
        while self.context.get_time() < until - 1e-9:
            self.simulator.AdvanceTo(self.context.get_time() + PARAMS.period)
            if self.follows:
                self.set("joint_positions", self.commanded())

    def run_until(self, phase: str, longest: float = 2.0) -> None:
        until = self.context.get_time() + longest
        while self.phase() != phase:
            assert self.context.get_time() < until, f"stays in {self.phase()}"
            self.run(PARAMS.period)

    def commanded(self) -> np.ndarray:
        q: np.ndarray = self.explorer.GetOutputPort("rest_positions").Eval(self.context)
        return q

    def phase(self) -> str:
        return str(self.explorer.GetOutputPort("phase").Eval(self.context))

    def touches(self) -> Contacts:
        contacts = self.explorer.GetOutputPort("touches").Eval(self.context)
        assert isinstance(contacts, Contacts)
        return contacts

    def untouched(self) -> object:
        return self.explorer.GetOutputPort("untouched").Eval(self.context)

    def count(self) -> float:
        return float(self.explorer.GetOutputPort("count").Eval(self.context)[0])


@pytest.fixture
def bench() -> Bench:
    return Bench()


def begin(bench: Bench, goal: float = 0.4) -> None:
    bench.set("holding", [1.0])
    bench.run_until("decide")
    bench.offer(goal)
    bench.run_until("reach")


def test_it_rests_until_the_hand_holds_and_a_motion_is_given(bench: Bench) -> None:
    bench.offer(0.4)
    bench.run(0.3)
    assert bench.phase() == "wait"
    np.testing.assert_allclose(bench.commanded(), bench.q_rest)
    bench.offer(None)
    bench.set("holding", [1.0])
    bench.run(0.3)
    assert bench.phase() == "decide"
    assert bench.explorer.GetOutputPort("deciding").Eval(bench.context)[0] == 1.0
    # One that was chosen before it was asked for is of an older estimate.
    bench.offer(0.4, time=0.0)
    bench.run(0.1)
    assert bench.phase() == "decide"
    bench.offer(0.4)
    bench.run(0.02)
    assert bench.phase() == "reach"
    assert bench.explorer.GetOutputPort("deciding").Eval(bench.context)[0] == 0.0


def test_what_a_finger_feels_is_remembered_and_it_comes_back(bench: Bench) -> None:
    begin(bench)
    bench.run(0.1)
    moved = bench.commanded() - bench.q_rest
    np.testing.assert_allclose(moved[bench.places], moved[bench.places][0])
    assert 0.1 < moved[bench.places][0] < 0.3, "it moves at 2 rad/s"
    assert np.count_nonzero(moved) == len(bench.places), "no other finger does"
    bench.touch(True)
    bench.run(0.02)
    assert bench.phase() == "press"
    held = bench.commanded()
    assert len(bench.touches()) == 2, "what the moving finger feels does not count before it is at rest"
    bench.run_until("return")
    np.testing.assert_allclose(bench.commanded(), held, atol=0.03)
    bench.touch(False)
    np.testing.assert_allclose(bench.touches().p_PC, np.concatenate([HELD.p_PC, FELT.p_PC]))
    bench.run_until("settle")
    np.testing.assert_allclose(bench.commanded(), bench.q_rest)
    assert bench.count() == 1.0
    assert bench.untouched() is None


def test_a_moment_of_force_is_no_touch(bench: Bench) -> None:
    begin(bench)
    bench.touch(True, FAINT)
    bench.run(0.03)
    assert bench.phase() == "reach"
    bench.touch(True)
    bench.run(0.02)
    assert bench.phase() == "press"
    bench.touch(False)
    bench.run(0.02)
    assert bench.phase() == "reach"
    bench.run_until("settle")
    assert len(bench.touches()) == 2


def test_where_a_fingertip_meets_nothing_is_remembered_too(bench: Bench) -> None:
    begin(bench)
    bench.run_until("settle")
    untouched = bench.untouched()
    assert untouched is not None
    apart = np.linalg.norm(np.diff(untouched.p_PH, axis=0), axis=1)
    assert len(untouched.radius) > 5
    assert apart.max() < 0.01
    assert len(bench.touches()) == 2


def test_a_finger_that_is_stopped_unfelt_comes_back_with_nothing(bench: Bench) -> None:
    begin(bench, 1.0)
    bench.follows = False
    bench.run_until("return")
    bench.follows = True
    bench.run_until("settle")
    assert bench.untouched() is None
    assert len(bench.touches()) == 2
    assert bench.count() == 1.0


def test_a_finger_whose_joints_are_not_known_comes_back(bench: Bench) -> None:
    begin(bench)
    bench.run(0.1)
    q = bench.commanded()
    q[bench.places[1]] = np.nan
    bench.set("joint_positions", q)
    bench.run(PARAMS.period)
    assert bench.phase() == "return"
    bench.run_until("settle")
    assert bench.untouched() is None
    assert bench.count() == 1.0


@pytest.mark.parametrize("is_moving", [False, True])
def test_what_was_felt_of_an_object_is_forgotten_with_it(bench: Bench, is_moving: bool) -> None:
    begin(bench)
    bench.run(0.1)
    bench.touch(True)
    bench.run_until("return")
    bench.touch(False)
    if not is_moving:
        bench.run_until("settle")
    assert len(bench.touches()) == 3
    before = bench.commanded()
    bench.set("holding", [0.0])
    bench.run(PARAMS.period)
    assert len(bench.touches()) == 2
    np.testing.assert_allclose(bench.commanded(), before, atol=0.03)
    bench.run_until("wait")
    np.testing.assert_allclose(bench.commanded(), bench.q_rest)
    assert bench.count() == 0.0
    bench.offer(None)
    bench.set("holding", [1.0])
    bench.run_until("decide")
    assert len(bench.touches()) == 2
    assert bench.explorer.GetOutputPort("deciding").Eval(bench.context)[0] == 1.0


def test_an_empty_hand_asks_for_no_motion(bench: Bench) -> None:
    bench.set("holding", [1.0])
    bench.run_until("decide")
    bench.set("holding", [0.0])
    bench.run(PARAMS.period)
    assert bench.phase() == "wait"
    assert bench.explorer.GetOutputPort("deciding").Eval(bench.context)[0] == 0.0


def test_a_clock_that_goes_back_begins_anew(bench: Bench) -> None:
    bench.context.SetTime(50.0)
    begin(bench)
    bench.run_until("settle")
    assert bench.untouched() is not None
    bench.context.SetTime(0.0)
    bench.simulator.Initialize()
    bench.run(PARAMS.period)
    assert bench.untouched() is None
    bench.run_until("decide")
    bench.run(0.1)
    assert bench.phase() == "decide", "the motion that is offered is of then"
    bench.offer(0.4)
    bench.run_until("reach")


def test_it_rests_after_the_most_touches(bench: Bench) -> None:
    begin(bench)
    bench.run_until("settle")
    bench.run_until("decide")
    bench.offer(0.4)
    bench.run_until("done", 5.0)
    assert bench.count() == PARAMS.most_touches
    bench.run(0.3)
    np.testing.assert_allclose(bench.commanded(), bench.q_rest)


def test_bad_parameters_are_refused() -> None:
    with pytest.raises(InvalidInputError, match=r"TouchExplorerParams\.speed"):
        TouchExplorerParams(speed=0.0).validate()
    with pytest.raises(InvalidInputError, match=r"TouchExplorerParams\.most_touches"):
        TouchExplorerParams(most_touches=0).validate()


@pytest.mark.parametrize("names", [(*NAMES, "ring"), (1, 2), ("thumb", "thumb"), ()])
def test_names_that_are_not_those_of_the_contacts_are_told(names: tuple) -> None:
    bench = Bench()
    bench.set("fingers_in_contact", names)
    with pytest.raises(PortTypeError, match=r"'fingers_in_contact' .* must hold as many different names as .*, 2, not"):
        bench.touches()
