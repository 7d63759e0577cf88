import copy
import pickle
from pathlib import Path

import numpy as np
import pytest
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.systems.analysis import Simulator
from scipy.stats import chi2

from tactopose_drake.core.poses import increments_between
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.errors import InvalidInputError
from tactopose_drake.hand.hand_config import load_hand_config
from tactopose_drake.resources import model_path
from tactopose_drake.systems.object_tracker import ObjectTracker
from tactopose_drake.systems.pose_tracking import MakePoseTracking, PoseTrackingParams
from tests import held_cube
from tests.hand.grippers import write_gripper
from tests.pressed_ball import make_ball, press


@pytest.fixture(scope="module")
def cube() -> ObjectModel:
    return ObjectModel.from_mesh(model_path("objects", "cube.obj"))


def params() -> PoseTrackingParams:
    return PoseTrackingParams(use_joint_velocities=False, use_hand_volume=False)


@pytest.fixture(scope="module")
def made(cube: ObjectModel) -> ObjectTracker:
    return ObjectTracker(load_hand_config("shadow_like"), cube, params())


@pytest.fixture
def tracker(made: ObjectTracker) -> ObjectTracker:
    """As it is made: all that it has been told stands in its context."""
    made.context = made.diagram.CreateDefaultContext()
    return made


@pytest.fixture(scope="module")
def moving(cube: ObjectModel) -> ObjectTracker:
    """One that is told the joints' velocities."""
    return ObjectTracker(load_hand_config("shadow_like"), cube, PoseTrackingParams(use_hand_volume=False))


def noisy(seed: int) -> dict[str, np.ndarray]:
    generator = np.random.default_rng(seed)
    return {finger: F_S + 1e-3 * generator.normal(size=6) for finger, F_S in held_cube.WRENCHES.items()}


def test_each_reading_gives_a_belief_of_its_time(tracker: ObjectTracker) -> None:
    assert tracker.estimate is None
    for k in range(10):
        belief = tracker.update(noisy(k), held_cube.Q, 5.0 + 0.013 * k, vision=held_cube.prior() if k == 0 else None)
        assert belief.time == 5.0 + 0.013 * k
    assert belief.status == "ok"
    assert np.linalg.norm(belief.X_PO[0, :, 3] - held_cube.X_PO[:, 3]) < 0.006
    assert tracker.estimate is not None
    np.testing.assert_array_equal(tracker.estimate.best.X_PO.GetAsMatrix34(), belief.X_PO[0])


def test_it_believes_what_the_diagram_in_a_simulator_believes(cube: ObjectModel, tracker: ObjectTracker) -> None:
    diagram = MakePoseTracking(load_hand_config("shadow_like"), cube, params())
    simulator = Simulator(diagram)
    context = simulator.get_mutable_context()
    diagram.GetInputPort("vision").FixValue(context, AbstractValue.Make(held_cube.prior()))
    for k in range(5):
        diagram.GetInputPort("joint_positions").FixValue(context, held_cube.Q)
        for finger, F_S in noisy(k).items():
            diagram.GetInputPort(f"wrench_{finger}").FixValue(context, F_S)
        simulator.AdvanceTo(0.01 * k + 1e-6)
        belief = tracker.update(noisy(k), held_cube.Q, context.get_time() - 1e-6, vision=held_cube.prior())
    theirs = diagram.GetOutputPort("belief").Eval(context)
    np.testing.assert_allclose(belief.X_PO, theirs.X_PO, atol=1e-9)
    assert belief.message == theirs.message


def test_a_guess_that_was_given_once_is_not_called_old(tracker: ObjectTracker) -> None:
    tracker.update(noisy(0), held_cube.Q, 0.0, vision=held_cube.prior())
    for k in range(1, 8):
        belief = tracker.update(noisy(k), held_cube.Q, 0.5 * k)
    assert not [remark for remark in belief.remarks if "vision" in remark]
    # So rarely felt, the cube may turn and slide between the fingers meanwhile: it is where the belief says, no nearer.
    off = increments_between(belief.X_PO[:1], held_cube.X_PO)[0]
    assert off @ np.linalg.solve(belief.covariance[0], off) < chi2.ppf(0.999, 6)
    assert np.linalg.norm(off[3:]) < 0.02


def test_joints_by_name_are_the_same_and_what_follows_follows(tracker: ObjectTracker) -> None:
    in_order = tracker.update(noisy(0), held_cube.Q, 0.0, vision=held_cube.prior()).X_PO
    by_name = dict(zip(tracker.joint_names, held_cube.Q.tolist(), strict=True))
    again = tracker.update(noisy(0), by_name, 0.0, vision=held_cube.prior())
    np.testing.assert_array_equal(tracker.diagram.GetInputPort("joint_positions").Eval(tracker.context), held_cube.Q)
    assert again.X_PO.shape == in_order.shape
    couplings = [coupling for finger in load_hand_config("shadow_like").fingers for coupling in finger.couplings]
    assert couplings
    for coupling in couplings:
        del by_name[coupling.joint]
    tracker.update(noisy(0), by_name, 0.0)
    q = dict(
        zip(tracker.joint_names, tracker.diagram.GetInputPort("joint_positions").Eval(tracker.context), strict=True)
    )
    for coupling in couplings:
        assert q[coupling.joint] == coupling.ratio * by_name[coupling.follows]


def test_a_clock_that_goes_back_begins_a_new_belief_and_says_so(tracker: ObjectTracker) -> None:
    tracker.update(noisy(0), held_cube.Q, 7.0, vision=held_cube.prior())
    belief = tracker.update(noisy(1), held_cube.Q, 2.0)
    assert "begun anew: the clock went back from 7 s" in belief.remarks
    assert belief.time == 2.0
    assert tracker.update(noisy(2), held_cube.Q, 2.0).time == 2.0  # The same time once more is no fault.


@pytest.mark.parametrize("reading", [np.full(6, np.nan), None, [np.inf] * 6])
def test_a_finger_without_a_reading_is_named_and_the_others_go_on(tracker: ObjectTracker, reading: object) -> None:
    tracker.update(noisy(0), held_cube.Q, 0.0, vision=held_cube.prior())
    belief = tracker.update({**noisy(1), "thumb": reading}, held_cube.Q, 0.01)
    assert "thumb: the wrench is not finite" in belief.message
    assert "thumb" not in tracker.diagram.GetOutputPort("fingers_in_contact").Eval(tracker.context)
    assert belief.has_pose


@pytest.mark.parametrize("strength", [1e3, 2e3, 1e20, 1e150, 1e300])
def test_a_force_beyond_all_reason_is_named_and_the_others_go_on(tracker: ObjectTracker, strength: float) -> None:
    tracker.update(noisy(0), held_cube.Q, 0.0, vision=held_cube.prior())
    thumb = held_cube.WRENCHES["thumb"] * strength / np.linalg.norm(held_cube.WRENCHES["thumb"][3:])
    belief = tracker.update({**noisy(1), "thumb": thumb}, held_cube.Q, 0.01)
    assert "thumb: the force is beyond 1000 N: it must be in millinewtons" in belief.message
    assert "thumb" not in tracker.diagram.GetOutputPort("fingers_in_contact").Eval(tracker.context)
    assert belief.has_pose


@pytest.mark.parametrize("value", [1e5, 1e20, 1e300, -1e300, np.inf, np.nan])
@pytest.mark.parametrize("sensor", ["wrenches", "joints", "joint_velocities"])
def test_whatever_a_sensor_says_there_is_a_belief_and_the_next_reading_counts(
    moving: ObjectTracker, sensor: str, value: float
) -> None:
    still = np.zeros(len(moving.joint_names))
    read = {"wrenches": noisy(0), "joints": held_cube.Q, "joint_velocities": still}
    moving.update(time=1.0, vision=held_cube.prior(), **read)
    absurd = {finger: np.full(6, value) for finger in held_cube.WRENCHES}
    belief = moving.update(time=1.01, **{**read, sensor: absurd if sensor == "wrenches" else still + value})
    assert belief.time == 1.01
    if sensor == "joint_velocities":
        assert [remark for remark in belief.remarks if remark.startswith("the fingertips' velocities are ")]
    belief = moving.update(time=1.02, **{**read, "wrenches": noisy(1)})
    assert not [remark for remark in belief.remarks if "velocities" in remark]


@pytest.mark.parametrize("value", [11.0, 1e5, 1e300])
def test_a_joint_that_slides_out_of_all_reach_is_not_known(tmp_path: Path, value: float) -> None:
    tracker = ObjectTracker(load_hand_config(write_gripper(tmp_path)), make_ball())
    pressed = {finger: [0.0, 0.0, 0.0, push, 0.0, 0.0] for finger, push in (("left", -1.0), ("right", 1.0))}
    assert "not known" not in tracker.update(pressed, [0.01, 0.01], 0.0, joint_velocities=[0.0, 0.0]).message
    belief = tracker.update(pressed, [value, 0.01], 0.01, joint_velocities=[0.0, 0.0])
    assert f"left: joint left_slide reads {value:.4g} m, not from -0.05 to 0.095" in belief.message
    assert "right" not in belief.message


def test_a_joint_that_reads_degrees_is_a_fault_of_that_joint(tracker: ObjectTracker) -> None:
    joints = dict(zip(tracker.joint_names, held_cube.Q, strict=True))
    assert "joint" not in tracker.update(noisy(0), joints, 0.0, vision=held_cube.prior()).message
    belief = tracker.update(noisy(1), joints | {"THJ4": 30.0}, 0.01)
    assert "thumb: joint THJ4 reads 30 rad, not from " in belief.message
    assert len(belief.contacts) == 4
    # A little beyond its limit it may be: encoders are off.
    assert "joint" not in tracker.update(noisy(2), joints | {"THJ4": 1.3}, 0.02).message


def test_no_reading_at_all_is_no_contact_and_then_lost(tracker: ObjectTracker) -> None:
    tracker.update(noisy(0), held_cube.Q, 0.0, vision=held_cube.prior())
    assert tracker.update({}, held_cube.Q, 0.01).status == "no_contact"
    assert tracker.update({}, held_cube.Q, 3.0).status == "lost"


def test_joints_that_are_not_known_are_said(tracker: ObjectTracker) -> None:
    belief = tracker.update(noisy(0), {}, 0.0)
    assert belief.message.count("a joint position is not known") == 5


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"wrenches": {"pinky": np.zeros(6)}}, "each name in wrenches must be one of first.*, not 'pinky'"),
        ({"wrenches": {"thumb": np.zeros(3)}}, r"wrenches\[thumb\] must have the shape \(6,\), not \(3,\)"),
        ({"wrenches": {"thumb": ["a"] * 6}}, r"wrenches\[thumb\].* must (be a number|consist of numbers), not"),
        ({"wrenches": np.zeros(6)}, "wrenches must be a Mapping, not an ndarray"),
        ({"joints": np.zeros(3)}, r"joints must have the shape \(24,\), not \(3,\)"),
        ({"joints": {"elbow": 0.0}}, "each name in joints must be one of .*, not 'elbow'"),
        ({"time": np.nan}, "time must be .*, not nan"),
        ({"time": -1.0}, "time must be .*, not -1"),
        ({"vision": np.eye(4)}, "vision must be a PoseMeasurement, a PosePrior or None, not an ndarray"),
        ({"palm_pose": np.ones((3, 4))}, "palm_pose"),
        (
            {"pressures": {"palm": np.zeros(24)}},
            r"pressures must be left out, as the hand has no tactile pads, not be given for \['palm'\]",
        ),
    ],
)
def test_a_mistake_is_one_error_and_changes_nothing(tracker: ObjectTracker, change: dict, message: str) -> None:
    before = tracker.update(noisy(0), held_cube.Q, 1.0, vision=held_cube.prior())
    given = {"wrenches": noisy(1), "joints": held_cube.Q, "time": 2.0, **change}
    with pytest.raises(InvalidInputError, match=message):
        tracker.update(**given)
    assert tracker.diagram.GetOutputPort("belief").Eval(tracker.context) is before


def test_a_tracker_is_made_anew_and_not_copied(tracker: ObjectTracker) -> None:
    for make in (copy.copy, copy.deepcopy, pickle.dumps):
        with pytest.raises(TypeError, match="an ObjectTracker cannot be copied or pickled; make another one"):
            make(tracker)


def test_pads_are_felt() -> None:
    hand, ball = load_hand_config("barrett_like"), make_ball()
    tracker = ObjectTracker(hand, ball, PoseTrackingParams(use_joint_velocities=False))
    diagram = MakePoseTracking(hand, ball, PoseTrackingParams(use_joint_velocities=False))
    context = diagram.CreateDefaultContext()
    p_PO = press(diagram, context, "vision")
    pressures = {pad.name: diagram.GetInputPort(f"pressures_{pad.name}").Eval(context) for pad in hand.pads}
    vision = diagram.GetInputPort("vision").Eval(context)
    belief = tracker.update({}, np.zeros(len(tracker.joint_names)), 0.0, pressures=pressures, vision=vision)
    assert np.linalg.norm(belief.X_PO[0, :, 3] - p_PO) < 0.002


def test_velocities_that_are_left_out_are_not_those_of_before(moving: ObjectTracker) -> None:
    turning = np.full(len(moving.joint_names), 0.3)
    moving.update(noisy(0), held_cube.Q, 0.0, vision=held_cube.prior(), joint_velocities=turning)
    for k in range(1, 30):
        belief = moving.update(noisy(k), held_cube.Q, 0.01 * k)
        assert "the fingertips' velocities are not known" in belief.remarks
    assert belief.status == "ok"
    assert np.linalg.norm(belief.X_PO[0, :, 3] - held_cube.X_PO[:, 3]) < 0.006


def test_pressures_and_vision_that_are_left_out_are_not_those_of_before() -> None:
    hand, ball = load_hand_config("barrett_like"), make_ball()
    tracker = ObjectTracker(hand, ball, PoseTrackingParams(use_joint_velocities=False))
    context = tracker.diagram.CreateDefaultContext()
    press(tracker.diagram, context, "vision")
    pressures = {pad.name: tracker.diagram.GetInputPort(f"pressures_{pad.name}").Eval(context) for pad in hand.pads}
    vision = tracker.diagram.GetInputPort("vision").Eval(context)
    joints = np.zeros(len(tracker.joint_names))
    tracker.update({}, joints, 0.0, pressures=pressures, vision=vision)
    tracker.update({}, joints, 0.01)
    assert tracker.diagram.GetInputPort("vision").Eval(tracker.context) is None
    for pad in hand.pads:
        assert np.isnan(tracker.diagram.GetInputPort(f"pressures_{pad.name}").Eval(tracker.context)).all()


def test_a_pad_that_hangs_is_named_although_the_joints_are_read_on() -> None:
    tracker = ObjectTracker(load_hand_config("barrett_like"), make_ball())
    random = np.random.default_rng(0)
    pressed = np.full(24, 3e4)
    pressed[0] = np.nan  # a dead cell
    for time in np.arange(0.0, 0.65, 0.1):
        joints = 1e-5 * random.normal(size=len(tracker.joint_names))
        pressures = {"finger_1": pressed * random.uniform(0.99, 1.01, 24), "finger_2": pressed}
        belief = tracker.update({}, joints, time, pressures=pressures)
    assert "the touch of pad finger_2 has been the same for 0.6 s" in belief.remarks


def test_a_pause_of_the_loop_is_no_touch_that_stays_the_same(tracker: ObjectTracker) -> None:
    for time in (0.0, 0.01):
        tracker.update(noisy(0), held_cube.Q, time, vision=held_cube.prior() if time == 0.0 else None)
    assert "has been the same" not in tracker.update(noisy(0), held_cube.Q, 50.0).message
    for time in (50.2, 50.4, 50.6):
        belief = tracker.update(noisy(0), held_cube.Q, time)
    assert "the touch has been the same for 0.6 s" in belief.remarks


@pytest.mark.parametrize(
    "unknown", [np.full((3, 4), np.nan), RigidTransform(np.full(3, np.nan))], ids=["array", "transform"]
)
def test_a_palm_that_is_not_known_is_said_and_the_object_goes_on(tracker: ObjectTracker, unknown: object) -> None:
    tracker.update(noisy(0), held_cube.Q, 0.0, vision=held_cube.prior(), palm_pose=RigidTransform([0.0, 0.0, 1.0]))
    belief = tracker.update(noisy(1), held_cube.Q, 0.01, palm_pose=unknown)  # type: ignore[arg-type]
    assert "the palm's pose is not finite" in belief.remarks
    assert np.isfinite(belief.X_PO).all()
    in_world = tracker.diagram.GetOutputPort("object_pose_in_world").Eval(tracker.context)
    assert np.isnan(in_world.translation()).all()


def test_what_was_felt_before_the_clock_went_back_is_not_remembered(tracker: ObjectTracker) -> None:
    for time in np.arange(0.0, 1.05, 0.1):
        belief = tracker.update(noisy(0), held_cube.Q, time, vision=held_cube.prior() if time == 0.0 else None)
    assert "the touch has been the same for 1.0 s" in belief.message
    belief = tracker.update(noisy(0), held_cube.Q, 0.7)
    assert "the clock went back" in belief.message
    assert "has been the same" not in belief.message


def test_the_palm_moves_the_world_and_not_the_object_in_it(tracker: ObjectTracker) -> None:
    X_WP = RigidTransform([1.0, 2.0, 3.0])
    tracker.update(noisy(0), held_cube.Q, 0.0, vision=held_cube.prior(), palm_pose=X_WP)
    in_world = tracker.diagram.GetOutputPort("object_pose_in_world").Eval(tracker.context)
    in_palm = tracker.diagram.GetOutputPort("object_pose").Eval(tracker.context)
    assert in_world.IsNearlyEqualTo(X_WP @ in_palm, 1e-12)
