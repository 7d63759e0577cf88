"""A belief over time that refines the encoders' offsets of a hand that is off, by grasps made up by kinematics."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from pydrake.common.value import AbstractValue
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, Diagram

import tactopose_drake as tp
from tactopose_drake.core.calibration.offset_refinement import OffsetRefinementParams
from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.motion.rigid_motion import MotionHistory
from tactopose_drake.core.poses import exp_so3, inverse, transform_points
from tactopose_drake.core.posterior.gaussian_mixture import GaussianMixture
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.tracking.keyframes import Keyframe
from tactopose_drake.core.tracking.pose_belief import PoseBelief
from tactopose_drake.errors import InvalidInputError
from tactopose_drake.hand.closed_grasps import ClosedGrasp, ClosedGraspParams
from tactopose_drake.hand.encoder_offsets import encoder_gains, radian_units
from tactopose_drake.hand.hand_config import HandUncertainty, load_hand_config
from tactopose_drake.hand.hand_in_plant import make_hand_plant
from tactopose_drake.hand.named_joints import NamedJoints
from tactopose_drake.resources import model_path
from tactopose_drake.systems import joint_offset_refiner
from tactopose_drake.systems.joint_offset_refiner import JointOffsetRefiner
from tactopose_drake.systems.object_tracker import ObjectTracker
from tactopose_drake.systems.pose_estimation import MakePoseEstimation, PoseEstimationParams
from tactopose_drake.systems.pose_tracking import MakePoseTracking, PoseTrackingParams
from tests.hand.calibrated_shadow import WrongHand
from tests.hand.grippers import write_gripper

UNCERTAINTY = HandUncertainty(
    encoder_offset_deg=2.0,
    fingertip_radius=1e-4,
    sensor_force=0.02,
    sensor_moment=2e-4,
    mounting=1e-4,
    mounting_deg=0.1,
)
PARAMS = PoseTrackingParams(
    use_joint_velocities=False, use_hand_volume=False, refinement=OffsetRefinementParams(least_frames=4)
)
GRASPS = ClosedGraspParams(noise_surface=1e-4, noise_normal_deg=1.0, least_fingers=5)
STEP = 0.01  # s


class Run:
    """A hand that is off, and its belief over time."""

    def __init__(self, seed: int, model: ObjectModel, params: PoseTrackingParams = PARAMS) -> None:
        self.hand, self.model = WrongHand(seed, UNCERTAINTY), model
        self.diagram: Diagram = MakePoseTracking(self.hand.config, model, params)
        # The touch of one instant, by readings that nothing is taken off.
        self.instant = MakePoseEstimation(self.hand.config, model, PoseEstimationParams(use_hand_volume=False))
        self.simulator = Simulator(self.diagram)
        self.context: Context = self.simulator.get_mutable_context()
        self.joints = NamedJoints(self.hand.plant, self.hand.hand)
        self.generator = np.random.default_rng(seed)
        self.time = 0.0

    def readings(self, grasp: ClosedGrasp) -> np.ndarray:
        return np.nan_to_num(self.joints.positions("joint_positions", dict(grasp.recorded.joint_positions)))

    def guess(self, grasp: ClosedGrasp) -> tp.PosePrior:
        R_PO = grasp.X_PO[:, :3] @ exp_so3(0.1 * self.generator.normal(size=3))
        p_PO = grasp.X_PO[:, 3] + 0.01 * self.generator.normal(size=3)
        return tp.PosePrior(np.column_stack([R_PO, p_PO]), sigma_translation=0.01, sigma_rotation=0.1)

    def hold(self, grasp: ClosedGrasp, frames: int = 18) -> None:
        """Feels a grasp for some frames, and nothing before."""
        self.feel({})
        self.time += 1.2
        self.diagram.GetInputPort("joint_positions").FixValue(self.context, self.readings(grasp))
        self.diagram.GetInputPort("vision").FixValue(self.context, AbstractValue.Make(self.guess(grasp)))
        self.simulator.AdvanceTo(self.time)
        for _ in range(frames):
            self.feel(dict(grasp.recorded.wrenches))
            self.time += STEP
            self.simulator.AdvanceTo(self.time)

    def feel(self, wrenches: dict[str, np.ndarray]) -> None:
        for finger in self.hand.hand.sensor_frames:
            noise = self.generator.normal(size=6) * np.repeat([1e-5, 1e-3], 3)
            wrench = wrenches[finger] + noise if finger in wrenches else np.zeros(6)
            self.diagram.GetInputPort(f"wrench_{finger}").FixValue(self.context, wrench)

    def said(self, port: str) -> np.ndarray:
        return np.array(self.diagram.GetOutputPort(port).Eval(self.context))

    @property
    def true_offsets(self) -> np.ndarray:
        joints = self.diagram.GetSubsystemByName("offset_refiner").joints
        known = [f"{joint} offset" in self.hand.errors.names for joint in joints]
        return np.array([self.hand.error(f"{j} offset") if k else np.nan for j, k in zip(joints, known, strict=True)])


@pytest.fixture(scope="module")
def bottle() -> ObjectModel:
    return ObjectModel.from_mesh(model_path("objects", "spray_bottle.obj"))


def contacts_of(run: Run, grasp: ClosedGrasp, offsets: np.ndarray) -> tp.Contacts:
    """The contacts of a grasp by the hand's readings less these offsets."""
    diagram, context = run.instant, run.instant.CreateDefaultContext()
    gains = encoder_gains(run.hand.plant, run.hand.hand).gains
    diagram.GetInputPort("joint_positions").FixValue(context, run.readings(grasp) - gains @ offsets)
    for finger in run.hand.hand.sensor_frames:
        wrench = grasp.recorded.wrenches.get(finger, np.zeros(6))
        diagram.GetInputPort(f"wrench_{finger}").FixValue(context, wrench)
    contacts: tp.Contacts = diagram.GetOutputPort("contacts").Eval(context)
    return contacts


def test_offsets_are_found_over_a_run_and_the_next_grasps_are_less_off(bottle: ObjectModel) -> None:
    run = Run(3, bottle)
    for grasp in run.hand.close(bottle, 8, GRASPS):
        run.hold(grasp)
    true, found, sigma = run.true_offsets, run.said("joint_offsets"), run.said("joint_offset_sigmas")
    of_fingers = ~np.isnan(true)
    left = (found - true)[of_fingers]
    assert np.sqrt(np.mean(left**2)) < 0.8 * np.sqrt(np.mean(true[of_fingers] ** 2))
    assert np.sqrt(np.mean(np.square(left / sigma[of_fingers]))) < 1.6
    gaps = []
    for grasp in run.hand.close(bottle, 6, GRASPS):
        X_OP = inverse(grasp.X_PO)
        felt = [contacts_of(run, grasp, offsets).p_PC for offsets in (0.0 * found, found)]
        gaps.append([np.abs(bottle.grid.distance(transform_points(X_OP, p_PC))) for p_PC in felt])
    before, after = (np.sqrt(np.mean(np.square(np.concatenate(each)))) for each in zip(*gaps, strict=True))
    assert after < 0.8 * before


def test_contacts_do_not_jump_while_something_is_held(bottle: ObjectModel) -> None:
    run = Run(4, bottle)
    first, second = run.hand.close(bottle, 2, GRASPS)
    run.hold(first, frames=40)
    felt = run.diagram.GetOutputPort("contacts").Eval(run.context)
    as_read = contacts_of(run, first, np.zeros(len(run.true_offsets)))
    assert np.any(run.said("joint_offsets") != 0.0)
    np.testing.assert_allclose(felt.p_PC, as_read.p_PC, atol=5e-4)  # but for the noise of the wrenches
    found = run.said("joint_offsets")
    run.hold(second, frames=2)
    felt = run.diagram.GetOutputPort("contacts").Eval(run.context)
    np.testing.assert_allclose(felt.p_PC, contacts_of(run, second, found).p_PC, atol=5e-4)
    assert np.abs(felt.p_PC - contacts_of(run, second, 0.0 * found).p_PC).max() > 5e-4


def test_a_touch_that_drops_out_for_a_moment_counts_once(bottle: ObjectModel) -> None:
    run = Run(4, bottle)
    (grasp,) = run.hand.close(bottle, 1, GRASPS)
    run.hold(grasp, frames=30)
    found, sigma = run.said("joint_offsets"), run.said("joint_offset_sigmas")
    assert np.any(found != 0.0)
    generator, noise = np.random.default_rng(0), np.repeat([1e-6, 1e-4], 3)
    for wrenches, frames in (({}, 8), (dict(grasp.recorded.wrenches), 40)):
        for _ in range(frames):
            run.feel({name: wrench + noise * generator.normal(size=6) for name, wrench in wrenches.items()})
            run.time += STEP
            run.simulator.AdvanceTo(run.time)
    belief = run.diagram.GetOutputPort("belief").Eval(run.context)
    assert belief.probability[0] > 0.98
    assert belief.explains_touch[0]
    np.testing.assert_array_equal(run.said("joint_offset_sigmas"), sigma)
    felt = run.diagram.GetOutputPort("contacts").Eval(run.context)
    np.testing.assert_allclose(felt.p_PC, contacts_of(run, grasp, 0.0 * found).p_PC, atol=5e-4)


def test_a_loop_without_a_simulator_refines_too(bottle: ObjectModel) -> None:
    run = Run(4, bottle)
    tracker = ObjectTracker(run.hand.config, bottle, PARAMS)
    first, second = run.hand.close(bottle, 2, GRASPS)
    time = 0.0
    for grasp, frames in ((first, 18), (second, 2)):
        q = run.readings(grasp)
        nothing = dict.fromkeys(run.hand.hand.sensor_frames, np.zeros(6))
        time += 1.2
        found = tracker.diagram.GetOutputPort("joint_offsets").Eval(tracker.context)
        tracker.update(nothing, q, time, vision=run.guess(grasp))
        for _ in range(frames):
            time += STEP
            noise = 1e-4 * run.generator.normal(size=6)
            wrenches = {finger: wrench + noise for finger, wrench in grasp.recorded.wrenches.items()}
            tracker.update(nothing | wrenches, q, time)
    assert np.any(found != 0.0), "by the first grasp"
    felt = tracker.diagram.GetOutputPort("contacts").Eval(tracker.context)
    np.testing.assert_allclose(felt.p_PC, contacts_of(run, second, found).p_PC, atol=5e-4)
    assert np.abs(felt.p_PC - contacts_of(run, second, 0.0 * found).p_PC).max() > 5e-4


def test_a_joint_that_slides_counts_a_millimetre_as_a_degree(tmp_path: Path) -> None:
    plant, _ = make_hand_plant(load_hand_config(write_gripper(tmp_path)))
    np.testing.assert_allclose(np.degrees(0.001 / radian_units(plant)), np.ones(2))
    shadow, _ = make_hand_plant(load_hand_config("shadow_like"))
    np.testing.assert_array_equal(radian_units(shadow), np.ones(shadow.num_positions()))


def felt_by_left() -> PoseBelief:
    """A settled belief."""
    contacts = Contacts(np.zeros((1, 3)), np.eye(3)[:1])
    touch = Keyframe(contacts.p_PC, contacts.n_PC, np.ones((1, 2)), ("left",), np.eye(3, 4), np.zeros((6, 6)), 8)
    return PoseBelief(
        time=1.0,
        status="ok",
        history=MotionHistory((1.0,)),
        mixture=GaussianMixture(np.eye(3, 4)[None], np.ones(1), np.eye(6)[None]),
        explains_touch=np.ones(1, dtype=np.bool_),
        contacts=contacts,
        keyframes=(touch,),
        touch_time=1.0,
    )


def asked_at(belief: PoseBelief, slides: list[float], folder: Path, monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """Where a sliding joint is, of these places in turn, as the belief tells of the offsets."""
    asked: list[float] = []
    plant, hand = make_hand_plant(load_hand_config(write_gripper(folder)))
    system = JointOffsetRefiner(plant, hand, UNCERTAINTY, tp.ObjectModel.from_sphere(0.03), PARAMS.refinement)
    context = system.CreateDefaultContext()

    def note(*arguments: object) -> object:
        asked.append(float(system.GetInputPort("joint_positions").Eval(context)[0]))
        return arguments[-1]

    monkeypatch.setattr(joint_offset_refiner, "refine_offsets", note)
    system.GetInputPort("belief").FixValue(context, AbstractValue.Make(belief))
    system.GetInputPort("contact_solutions").FixValue(context, AbstractValue.Make({}))
    for slid in slides:
        system.GetInputPort("joint_positions").FixValue(context, np.array([slid, 0.0]))
        system.advance(context)
    return asked


def test_a_touch_tells_again_once_a_sliding_joint_has_moved_by_as_many_millimetres_as_others_by_degrees(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert PARAMS.refinement is not None
    assert PARAMS.refinement.least_turn_deg == 10.0
    asked = asked_at(felt_by_left(), [0.0, 0.009, 0.011, 0.02, 0.022], tmp_path, monkeypatch)
    assert asked == [0.0, 0.011, 0.022]


@pytest.mark.parametrize("lack", ["status", "probability", "explanation", "frames"])
def test_a_belief_that_is_not_settled_tells_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, lack: str) -> None:
    belief = felt_by_left()
    two = GaussianMixture(np.stack([np.eye(3, 4)] * 2), np.full(2, 0.5), np.stack([np.eye(6)] * 2))
    change = {
        "status": {"status": "slipping"},
        "probability": {"mixture": two, "explains_touch": np.ones(2, dtype=np.bool_)},
        "explanation": {"explains_touch": np.zeros(1, dtype=np.bool_)},
        "frames": {"keyframes": (dataclasses.replace(belief.keyframes[0], frames=3),)},  # 4 are needed
    }[lack]
    assert asked_at(dataclasses.replace(belief, **change), [0.0], tmp_path, monkeypatch) == []


def test_it_is_off_by_default_and_refuses_what_cannot_be(bottle: ObjectModel) -> None:
    config = Run(0, bottle).hand.config
    assert not MakePoseTracking(config, bottle).HasSubsystemNamed("offset_refiner")
    assert not MakePoseTracking(config, bottle).HasOutputPort("joint_offsets")
    for wrong in ({"least_sigma_deg": 0.0}, {"least_frames": 0}, {"chance": -1.0}):
        params = dataclasses.replace(PARAMS, refinement=OffsetRefinementParams(**wrong))
        with pytest.raises(InvalidInputError, match=f"OffsetRefinementParams.{next(iter(wrong))}"):
            MakePoseTracking(config, bottle, params)
