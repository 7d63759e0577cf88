"""Messages into a diagram and out of it, through Drake's own LCM within this process."""

import math

import numpy as np
import pytest
from pydrake.common.value import AbstractValue
from pydrake.lcm import DrakeLcm
from pydrake.math import RigidTransform
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, DiagramBuilder, LeafSystem
from pydrake.systems.lcm import LcmInterfaceSystem, LcmPublisherSystem, LcmSubscriberSystem

from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.tracking.pose_tracker import PoseTracker
from tactopose_drake.core.tracking.tracker_params import PoseTrackerParams
from tactopose_drake.drivers.lcm_messages import HandSensesMessage, ObjectBeliefMessage
from tactopose_drake.errors import InvalidInputError, ProtocolError
from tactopose_drake.estimation.pose_hypothesis import PoseHypothesis
from tactopose_drake.estimation.results import PoseEstimate
from tactopose_drake.hand.hand_config import load_hand_config
from tactopose_drake.systems.lcm_belief import LcmBelief
from tactopose_drake.systems.lcm_hand_senses import LcmHandSenses
from tests import held_cube


class Wired:
    """Senses in by LCM, on ports; and a belief out."""

    def __init__(self, hand: str) -> None:
        self.lcm = DrakeLcm("memq://")
        builder = DiagramBuilder()
        interface = builder.AddSystem(LcmInterfaceSystem(self.lcm))
        subscriber = builder.AddSystem(LcmSubscriberSystem.Make("SENSES", HandSensesMessage, interface))
        self.senses = builder.AddNamedSystem("senses", LcmHandSenses(load_hand_config(hand), max_age=0.1))
        builder.Connect(subscriber.get_output_port(), self.senses.get_input_port())
        self.belief = builder.AddNamedSystem("belief", LcmBelief(max_modes=2))
        builder.Connect(subscriber.get_output_port(), self.belief.GetInputPort("senses"))
        publisher = builder.AddSystem(LcmPublisherSystem.Make("BELIEF", ObjectBeliefMessage, interface, 0.01))
        builder.Connect(self.belief.get_output_port(), publisher.get_input_port())
        self.got: list[ObjectBeliefMessage] = []
        self.lcm.Subscribe("BELIEF", lambda data: self.got.append(ObjectBeliefMessage.decode(data)))
        self.simulator = Simulator(builder.Build())
        self.tell(None, "lost: no estimate yet")

    def tell(self, estimate: PoseEstimate | None, status: str) -> None:
        context = self.belief.GetMyMutableContextFromRoot(self.simulator.get_mutable_context())
        self.belief.GetInputPort("hypotheses").FixValue(context, AbstractValue.Make(estimate))
        self.belief.GetInputPort("status").FixValue(context, AbstractValue.Make(status))

    def run(self, duration: float, *messages: HandSensesMessage) -> None:
        for message in messages:
            self.lcm.Publish("SENSES", message.encode())
        self.simulator.AdvanceTo(self.simulator.get_context().get_time() + duration)

    def value(self, port: str):
        return self.senses.GetOutputPort(port).Eval(self.senses.GetMyContextFromRoot(self.simulator.get_context()))


def test_senses_come_to_their_ports_and_grow_old() -> None:
    wired = Wired("shadow_like")
    wired.run(0.02)
    assert wired.value("status") == "no message yet"
    assert np.all(np.isnan(wired.value("wrench_thumb")))
    assert np.isinf(wired.value("age"))
    message = HandSensesMessage(utime=5, sequence=1, joints={"FFJ3": 0.3}, wrenches=dict(held_cube.WRENCHES))
    wired.run(0.02, message)
    assert wired.value("status") == "ok"
    for finger, F_S in held_cube.WRENCHES.items():
        np.testing.assert_array_equal(wired.value(f"wrench_{finger}"), F_S)
    assert np.nansum(wired.value("joint_positions")) >= 0.3
    wired.run(0.2)
    assert wired.value("status").startswith("stale: 0.2")
    assert np.all(np.isnan(wired.value("wrench_thumb")))
    assert np.all(np.isnan(wired.value("joint_positions")))
    wired.run(0.01, HandSensesMessage(utime=6, sequence=2, wrenches={"thumb": np.ones(6)}))
    assert wired.value("status") == "ok"
    np.testing.assert_array_equal(wired.value("wrench_thumb"), np.ones(6))
    assert np.all(np.isnan(wired.value("wrench_first")))


def test_a_message_that_was_overtaken_is_not_taken_for_a_new_one() -> None:
    wired = Wired("shadow_like")
    context = wired.belief.GetMyMutableContextFromRoot(wired.simulator.get_mutable_context())
    belief = PoseTracker(ObjectModel.from_sphere(0.03), PoseTrackerParams()).start(1.0)
    wired.belief.GetInputPort("belief").FixValue(context, AbstractValue.Make(belief))
    wired.run(0.03, HandSensesMessage(utime=20_000, sequence=2, wrenches={"thumb": np.full(6, 2.0)}))
    wired.run(0.03, HandSensesMessage(utime=10_000, sequence=1, wrenches={"thumb": np.full(6, 1.0)}))
    np.testing.assert_array_equal(wired.value("wrench_thumb"), np.full(6, 2.0))
    assert wired.value("age") > 0.05
    assert wired.got[-1].sequence == 2
    wired.run(0.01, HandSensesMessage(utime=5_000, sequence=0, wrenches={"thumb": np.full(6, 3.0)}))
    np.testing.assert_array_equal(wired.value("wrench_thumb"), np.full(6, 3.0))  # of a sender that begins anew


def test_a_message_of_before_the_clock_went_back_is_not_fresh() -> None:
    wired = Wired("shadow_like")
    wired.run(2.0)
    wired.run(0.02, HandSensesMessage(utime=5, sequence=1, wrenches=dict(held_cube.WRENCHES)))
    assert wired.value("status") == "ok"
    wired.simulator.get_mutable_context().SetTime(0.5)
    wired.simulator.Initialize()
    wired.run(0.1)
    assert wired.value("status") == "stale: 1.40 s in the future, and may be at most 0.1 s"
    assert np.all(np.isnan(wired.value("wrench_thumb")))
    assert np.all(np.isnan(wired.value("joint_positions")))
    wired.run(0.02, HandSensesMessage(utime=6, sequence=2, wrenches=dict(held_cube.WRENCHES)))
    assert wired.value("status") == "ok"


@pytest.mark.parametrize(("utime", "status"), [(5, "stale: 0."), (0, "ok")], ids=["repeated", "without a clock"])
def test_messages_that_repeat_a_measurement_do_not_make_it_younger(utime: int, status: str) -> None:
    """A sender without a clock gives 0; its messages are as old as their arrival."""
    wired = Wired("shadow_like")
    for sequence in range(15):
        wired.run(0.02, HandSensesMessage(utime=utime, sequence=sequence, wrenches=dict(held_cube.WRENCHES)))
    assert wired.value("status").startswith(status)
    assert np.isnan(wired.value("wrench_thumb")).all() == (status != "ok")
    wired.run(0.02, HandSensesMessage(utime=6, sequence=15, wrenches=dict(held_cube.WRENCHES)))
    assert wired.value("status") == "ok"


class _OneMessage(LeafSystem):
    """A driver that fills the same message again and again."""

    def __init__(self) -> None:
        super().__init__()
        self.message = HandSensesMessage(sequence=0)
        self.DeclareAbstractOutputPort("message", lambda: AbstractValue.Make(HandSensesMessage()), self._calc)

    def _calc(self, context: Context, output: AbstractValue) -> None:
        time = context.get_time()
        self.message.utime, self.message.sequence = round(1e6 * time), round(1e3 * time)
        self.message.wrenches = {"thumb": np.full(6, time)}
        output.set_value(self.message)


def test_a_sender_that_uses_one_message_again_is_alive() -> None:
    builder = DiagramBuilder()
    driver = builder.AddSystem(_OneMessage())
    senses = builder.AddSystem(LcmHandSenses(load_hand_config("shadow_like"), max_age=0.1))
    builder.Connect(driver.get_output_port(), senses.get_input_port())
    simulator = Simulator(builder.Build())
    simulator.AdvanceTo(0.5)
    context = senses.GetMyContextFromRoot(simulator.get_context())
    assert senses.GetOutputPort("status").Eval(context) == "ok"
    np.testing.assert_allclose(senses.GetOutputPort("wrench_thumb").Eval(context), 0.5, atol=0.003)


def test_pads_too_and_what_does_not_fit_is_said() -> None:
    wired = Wired("barrett_like")
    message = HandSensesMessage(
        utime=1,
        sequence=0,
        joints={"elbow": 0.0},
        wrenches={"thumb": np.zeros(6)},
        pressures={"palm": np.full(24, 3.0), "finger_1": np.zeros(5)},
    )
    wired.run(0.02, message)
    np.testing.assert_array_equal(wired.value("pressures_palm"), np.full(24, 3.0))
    assert np.all(np.isnan(wired.value("pressures_finger_1")))
    for text in ("no joint 'elbow'", "no finger 'thumb'", "the pad 'finger_1' has 24 cells and not 5"):
        assert text in wired.value("status")


def test_a_belief_goes_out_with_the_time_of_its_senses() -> None:
    wired = Wired("shadow_like")
    wired.run(0.03)
    assert wired.got[-1].status == "lost: no estimate yet"
    assert wired.got[-1].sequence == -1
    assert len(wired.got[-1].probability) == 0
    rest = (np.eye(6), np.zeros((0, 6)))
    hypotheses = tuple(
        PoseHypothesis(RigidTransform([0.1 * k, 0.0, 0.0]), 1.0, share, *rest)
        for k, share in enumerate((0.6, 0.3, 0.1))
    )
    wired.tell(PoseEstimate(hypotheses, "ok", 0.001), "ok")
    wired.run(0.05, HandSensesMessage(utime=77, sequence=4))
    belief = wired.got[-1]
    assert (belief.utime, belief.sequence, belief.status) == (77, 4, "ok")
    np.testing.assert_array_equal(belief.probability, [0.6, 0.3])
    np.testing.assert_allclose(belief.position[1], [0.1, 0.0, 0.0])
    np.testing.assert_array_equal(belief.quaternion_wxyz, [[1, 0, 0, 0]] * 2)
    assert belief.session == wired.got[0].session > 0
    assert math.isfinite(belief.covariance.sum())


def test_without_senses_a_belief_is_of_the_diagrams_time_and_of_no_message() -> None:
    system = LcmBelief(1)
    context = system.CreateDefaultContext()
    hypotheses = tuple(PoseHypothesis(RigidTransform(), 0.0, p, np.eye(6), np.zeros((0, 6))) for p in (0.7, 0.3))
    system.GetInputPort("hypotheses").FixValue(context, AbstractValue.Make(PoseEstimate(hypotheses, "ok", 0.001)))
    system.GetInputPort("status").FixValue(context, AbstractValue.Make("ok"))
    for time, utime in ((0.0, 0), (1.25, 1_250_000), (3.5000004, 3_500_000)):
        context.SetTime(time)
        message = system.get_output_port().Eval(context)
        assert (message.utime, message.sequence) == (utime, -1)
        np.testing.assert_array_equal(message.probability, [0.7])


def test_a_late_belief_has_the_time_of_the_senses_that_it_is_of() -> None:
    wired = Wired("shadow_like")
    context = wired.belief.GetMyMutableContextFromRoot(wired.simulator.get_mutable_context())

    def tell(time: float) -> None:
        belief = PoseTracker(ObjectModel.from_sphere(0.03), PoseTrackerParams()).start(time)
        wired.belief.GetInputPort("belief").FixValue(context, AbstractValue.Make(belief))

    tell(0.0)
    wired.run(0.05)
    for k in range(5):
        wired.run(0.1, HandSensesMessage(utime=1_000_000 + 100_000 * k, sequence=k))
    assert (wired.got[-1].utime, wired.got[-1].sequence) == (0, -1)  # Of before the first.
    for late in (0.25, 0.15, 0.05):
        tell(0.55 - late)
        wired.run(0.011)
        assert wired.got[-1].sequence == 4 - round((late - 0.05) / 0.1)
        assert wired.got[-1].utime == 1_000_000 + 100_000 * wired.got[-1].sequence
    wired.simulator.get_mutable_context().SetTime(0.15)
    wired.simulator.Initialize()
    tell(0.16)
    wired.run(0.05)
    assert wired.got[-1].sequence == 4  # The clock went back: what is there now is the newest.


def test_the_senses_that_a_belief_remembers_are_not_copied_with_the_state() -> None:
    """Each update of any system copies the state of the whole diagram, and a belief remembers thousands of messages."""
    wired = Wired("shadow_like")
    for sequence in range(3):
        wired.run(0.01, HandSensesMessage(utime=sequence, sequence=sequence))
    root = wired.simulator.get_context()
    copied = root.Clone()
    remembered, same = (
        wired.belief.GetMyContextFromRoot(each).get_abstract_state(0).get_value() for each in (root, copied)
    )
    assert len(remembered.heard) == 3
    assert same is remembered


@pytest.mark.parametrize("most", [0, -1, 2.5])
def test_a_belief_of_no_modes_is_refused(most: int) -> None:
    with pytest.raises(InvalidInputError, match="max_modes must be an integer >= 1, not "):
        LcmBelief(most)


def test_a_damaged_message_ends_the_simulation_with_an_error() -> None:
    wired = Wired("shadow_like")
    wired.lcm.Publish("SENSES", b"nonsense")
    with pytest.raises(ProtocolError, match="of this version"):
        wired.run(0.02)
