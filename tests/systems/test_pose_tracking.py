import gc
import threading
import weakref

import numpy as np
import pytest
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, Diagram, DiagramBuilder

from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.errors import InvalidInputError
from tactopose_drake.estimation.prior import PosePrior
from tactopose_drake.hand.hand_config import load_hand_config
from tactopose_drake.systems.pose_belief_estimator import PoseBeliefParams
from tactopose_drake.systems.pose_estimation import MakePoseEstimation
from tactopose_drake.systems.pose_tracking import AddPoseTracking, MakePoseTracking, PoseTrackingParams
from tests.core.tracking.boxes import make_box
from tests.pressed_ball import SILENT, make_ball, press


@pytest.fixture(scope="module")
def box() -> ObjectModel:
    return make_box()


@pytest.mark.parametrize("hand", ["shadow_like", "barrett_like"])
def test_a_hand_that_feels_nothing_knows_what_vision_says(box: ObjectModel, hand: str) -> None:
    config, builder = load_hand_config(hand), DiagramBuilder()
    tracking = AddPoseTracking(builder, config, box)
    diagram = builder.Build()
    simulator = Simulator(diagram)
    context = tracking.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    for index in range(tracking.num_input_ports()):
        port = tracking.get_input_port(index)
        name = port.get_name()
        if name.startswith(("wrench_", "joint_", "pressures_")):
            port.FixValue(context, np.zeros(port.size()))
    # Out of the hand's reach, so that its volume does not move it.
    X_PO, X_WP = RigidTransform([0.0, -0.5, 0.0]), RigidTransform([1.0, 0.0, 0.0])
    tracking.GetInputPort("palm_pose").FixValue(context, AbstractValue.Make(X_WP))
    simulator.AdvanceTo(0.02)
    untouched = "no contact" if config.pads else "the force is below min_force (0.05 N)"
    silent = "; ".join(f"{part.name}: {untouched}" for part in config.pads or config.fingers)
    assert tracking.GetOutputPort("status").Eval(context) == f"lost: nothing is touched; {silent}"
    tracking.GetInputPort("vision").FixValue(context, AbstractValue.Make(PosePrior(X_PO)))
    simulator.AdvanceTo(0.05)
    assert tracking.GetOutputPort("status").Eval(context) == f"no_contact: {silent}"
    assert tracking.GetOutputPort("object_pose").Eval(context).IsNearlyEqualTo(X_PO, 1e-9)
    np.testing.assert_allclose(
        tracking.GetOutputPort("object_pose_vector").Eval(context), [1.0, 0, 0, 0, 0, -0.5, 0], atol=1e-9
    )
    assert tracking.GetOutputPort("object_pose_in_world").Eval(context).IsNearlyEqualTo(X_WP @ X_PO, 1e-9)


def test_a_prior_never_ages_while_nothing_was_felt_and_no_port_of_the_estimation_is_missing(box: ObjectModel) -> None:
    config = load_hand_config("shadow_like")
    diagram, estimation = MakePoseTracking(config, box), MakePoseEstimation(config, box)
    names = {estimation.get_input_port(i).get_name() for i in range(estimation.num_input_ports())}
    assert all(diagram.HasInputPort(name) for name in names)
    simulator = Simulator(diagram)
    context = simulator.get_mutable_context()
    for name in names - {"prior", "planes"}:
        port = diagram.GetInputPort(name)
        port.FixValue(context, np.zeros(port.size()))
    X_PO = RigidTransform([0.0, -0.5, 0.0])
    diagram.GetInputPort("prior").FixValue(context, AbstractValue.Make(PosePrior(X_PO)))
    spread = []
    for time in (0.1, 2.0):
        simulator.AdvanceTo(time)
        assert str(diagram.GetOutputPort("status").Eval(context)).startswith("no_contact")
        spread.append(diagram.GetOutputPort("covariance").Eval(context).copy())
    np.testing.assert_array_equal(spread[0], spread[1])


def test_a_frame_that_is_old_counts_for_nothing_and_is_named() -> None:
    diagram = MakePoseTracking(
        load_hand_config("barrett_like"), make_ball(), PoseTrackingParams(use_joint_velocities=False)
    )
    simulator = Simulator(diagram)
    context = simulator.get_mutable_context()
    p_PO = press(diagram, context, "vision")

    def run(duration: float) -> str:
        simulator.AdvanceTo(context.get_time() + duration)
        return str(diagram.GetOutputPort("status").Eval(context))

    assert run(0.2) in (f"ok: {SILENT}", f"ambiguous: {SILENT}")
    assert np.linalg.norm(diagram.GetOutputPort("object_pose").Eval(context).translation() - p_PO) < 0.002
    diagram.GetInputPort("age_palm").FixValue(context, [0.5])
    assert run(0.05) == f"no_contact: {SILENT}; palm: stale: 0.50 s old"
    touched = diagram.GetOutputPort("belief").Eval(context).touch_time
    assert touched < 0.205
    status = run(1.0)
    assert status.startswith("lost: nothing was touched or seen for 1.")
    assert status.endswith("; palm: stale: 0.50 s old")
    diagram.GetInputPort("age_palm").FixValue(context, [0.0])
    assert run(0.2).split(":")[0] in ("ok", "ambiguous")


def test_a_pad_is_known_again_when_others_come_and_go() -> None:
    """Else its systematic error would become another's."""
    diagram = MakePoseTracking(
        load_hand_config("barrett_like"),
        make_ball(),
        PoseTrackingParams(use_joint_velocities=False, use_hand_volume=False),
    )
    simulator = Simulator(diagram)
    context = simulator.get_mutable_context()
    press(diagram, context, "vision")
    simulator.AdvanceTo(0.02)
    diagram.GetInputPort("age_finger_1").FixValue(context, [9.0])
    simulator.AdvanceTo(0.04)
    assert diagram.GetOutputPort("belief").Eval(context).sources == ("pad palm",)


def test_pads_that_move_move_what_they_hold() -> None:
    hand = load_hand_config("barrett_like")
    diagram = MakePoseTracking(hand, make_ball(), PoseTrackingParams(use_hand_volume=False))
    simulator = Simulator(diagram)
    context = simulator.get_mutable_context()
    press(diagram, context, "vision")
    size = diagram.GetInputPort("joint_velocities").size()
    diagram.GetInputPort("joint_velocities").FixValue(context, np.ones(size))
    simulator.AdvanceTo(0.01)
    tips = diagram.GetSubsystemByName("fingertip_velocities")
    velocities = tips.get_output_port().Eval(tips.GetMyContextFromRoot(context))
    assert set(velocities) == {f"pad {pad.name}" for pad in hand.pads}
    assert not np.any(velocities["pad palm"])
    assert np.all([np.any(velocity) for name, velocity in velocities.items() if name != "pad palm"])


def test_parameters_out_of_range_are_refused(box: ObjectModel) -> None:
    with pytest.raises(InvalidInputError, match="latency"):
        AddPoseTracking(
            DiagramBuilder(),
            load_hand_config("shadow_like"),
            box,
            PoseTrackingParams(belief=PoseBeliefParams(latency=-1.0)),
        )


def test_a_diagram_that_is_dropped_takes_the_thread_of_its_belief_with_it(box: ObjectModel) -> None:
    def make() -> tuple[weakref.ref[Diagram], Context, threading.Thread]:
        builder = DiagramBuilder()
        AddPoseTracking(builder, load_hand_config("shadow_like"), box, PoseTrackingParams(live=True))
        diagram = builder.Build()
        context = diagram.CreateDefaultContext()
        belief = diagram.GetSubsystemByName("pose_tracking").GetSubsystemByName("pose_belief")
        exchange = belief._own.Eval(belief.GetMyContextFromRoot(context)).exchange
        belief._start(exchange)
        return weakref.ref(diagram), context, exchange.thread

    diagram, _context, thread = make()
    gc.collect()
    assert diagram() is None
    thread.join(10.0)
    assert not thread.is_alive()
