"""A scenario for a hand and an object that nobody has written one for."""

import math

import numpy as np
from pydrake.common.schema import Rotation, Transform
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix

from tactopose_drake.core.grasping.finger_reach import ReachParams
from tactopose_drake.core.grasping.grasp_planner import HandReach
from tactopose_drake.core.grasping.rod_direction import rod_direction
from tactopose_drake.core.validation import FloatArray
from tactopose_drake.errors import InvalidInputError
from tactopose_drake.hand.hand_config import load_hand_config
from tactopose_drake.hand.hand_in_plant import Hand, make_hand_plant, pose_by_model
from tactopose_drake.hand.hand_reach import make_hand_reach
from tactopose_drake.station.scenario import Scenario
from tactopose_drake.systems.force_torque_sensor import sufficient_calibration

_CAMERA_DISTANCE = 0.4  # from the grip region's middle, m
_SLOWEST = 0.1  # s that a joint's damping may take to let the grasp controller's spring close it
_POINTS = 200  # of a fingertip's surface that are looked at
_LEAST_FINGERS = 3  # of a hand whose fingers may not all oppose each other


def scenario_for(hand: str, object_: str, seed: int = 0) -> Scenario:
    """A planned grasp of an object by a hand, whose palm stands so that upright objects fit between its fingers.

    Where the hand's model itself fixes it to the world, it stands there.

    The camera looks over the back of the palm. Joints that the model damps get a spring that is as much stiffer, and
    the sensors bear the forces of planned grasps on any place of the fingertips.

    Args:
        hand: one of the package by name, or a *.hand.yaml by path.
        object_: one of the package by name, or a model or mesh by path.
        seed: of the grasp and all noise.

    Raises:
        InvalidInputError: if the hand cannot be read, or its fingertips sense no forces: a grip until the fingers stall
            needs a scenario that says where the object is held.
    """
    config = load_hand_config(hand)
    reach = make_hand_reach(config, ReachParams())
    plant, parts = make_hand_plant(config)
    base = plant.GetFrameByName(config.base_link, parts.model_instance)
    X_BaseP = plant.CalcRelativeTransform(plant.CreateDefaultContext(), base, parts.palm_frame)
    X_WBase = pose_by_model(config)
    if X_WBase is None:
        R_WP = RotationMatrix.MakeFromOneVector(object_axis(reach), 2).inverse()
        X_WBase = RigidTransform(R_WP @ X_BaseP.rotation().inverse(), np.zeros(3))
    middle_P = 0.5 * (reach.grip_low + reach.grip_high)
    X_WP = X_WBase @ X_BaseP
    back = X_WP.rotation() @ _unit(_palm_middle(reach) - middle_P)
    view = _unit(back + 0.5 * np.array([0.0, 0.0, 1.0]))
    X_WC = RigidTransform(RotationMatrix.MakeFromOneVector(-view, 2), X_WP @ middle_P + _CAMERA_DISTANCE * view)
    driven = [plant.GetJointByName(name, parts.model_instance) for finger in config.fingers for name in finger.joints]
    damping = max(float(np.max(joint.default_damping_vector())) for joint in driven)
    scenario = Scenario(hand=hand, object=object_, seed=seed, X_WBase=_transform(X_WBase), X_WC=_transform(X_WC))
    scenario.planner.least_fingers = _LEAST_FINGERS
    stiffness = max(scenario.controller.finger_stiffness, damping / _SLOWEST)
    scenario.reach.stiffness = scenario.controller.finger_stiffness = stiffness
    scenario.controller.other_stiffness = max(scenario.controller.other_stiffness, 3.0 * stiffness)
    force = scenario.planner.most_force * math.hypot(1.0, scenario.planner.friction)
    scenario.sensor.calibration = sufficient_calibration(force, force * _longest_arm(parts), scenario.sensor.file)
    return scenario


def _longest_arm(hand: Hand) -> float:
    """How far a fingertip's surface reaches from its sensor at the most, m."""
    points = [surface.sample(np.random.default_rng(0), _POINTS) for surface in hand.surfaces.values()]
    return max(float(np.linalg.norm(p_SC, axis=1).max()) for p_SC in points)


def object_axis(reach: HandReach) -> FloatArray:
    """The direction in P in which a long object goes through the hand, shape (3,).

    It is across the ways from the grip region to the fingertips, which press on the object, and to the palm, which
    would be in its way; where the fingers cannot close on a rod that lies so, it is a direction in which they can.
    """
    middle = 0.5 * (reach.grip_low + reach.grip_high)
    sides = []
    for finger in reach.fingers.values():
        offset = finger.reached - middle
        nearest = offset[np.argsort(np.linalg.norm(offset, axis=1))[: len(offset) // 20]]
        sides.append(_unit(nearest.mean(axis=0)))
    sides.append(_unit(_palm_middle(reach) - middle))
    _, _, axes = np.linalg.svd(np.array(sides), full_matrices=True)
    axis: FloatArray = axes[-1] * math.copysign(1.0, axes[-1][np.argmax(np.abs(axes[-1]))])
    return rod_direction(axis, reach.fingers, reach.palm_spheres, reach.grip_low, reach.grip_high)


def _palm_middle(reach: HandReach) -> FloatArray:
    centres, _ = reach.palm_spheres
    if not len(centres):
        raise InvalidInputError("hand: its palm has no collision geometry, which the object must not be in.")
    middle: FloatArray = centres.mean(axis=0)
    return middle


def _unit(v: FloatArray) -> FloatArray:
    unit: FloatArray = v / max(float(np.linalg.norm(v)), 1e-9)
    return unit


def _transform(X: RigidTransform) -> Transform:
    """As a scenario's file has it, to a hundredth of a degree and a tenth of a millimetre."""
    angles = np.round(np.degrees(RollPitchYaw(X.rotation()).vector()), 2)
    return Transform(translation=np.round(X.translation(), 4), rotation=Rotation(value=Rotation.Rpy(deg=angles)))
