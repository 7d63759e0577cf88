"""Automatic scenarios for any hand and object."""

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
_SLOWEST = 0.1  # largest time constant of joint damping over controller stiffness, s
_POINTS = 200  # sampled points of a fingertip's surface
_LEAST_FINGERS = 3  # of a grasp, as not all fingers of an unknown hand may oppose each other


def scenario_for(hand: str, object_: str, seed: int = 0) -> Scenario:
    """A scenario of a planned grasp, with the palm oriented so that upright objects fit between the fingers.

    If the hand's model fixes it to the world, it stays there. The camera looks over the back of the palm. The
    controller's stiffness grows with the joints' damping, and the sensors' range covers the forces of planned grasps
    anywhere on the fingertips.

    Args:
        hand: one of the package by name, or a *.hand.yaml by path.
        object_: one of the package by name, or a model or mesh by path.
        seed: seed of the grasp and all noise.

    Raises:
        InvalidInputError: if the hand cannot be read, or its fingertips sense no forces: closing until the fingers
            stall needs a scenario with the object's pose in the hand.
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
    driven = [plant.GetJointByName(name, parts.model_instance) for name in config.driven]
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
    """The largest distance of a fingertip's surface from its sensor, m."""
    points = [surface.sample(np.random.default_rng(0), _POINTS) for surface in hand.surfaces.values()]
    return max(float(np.linalg.norm(p_SC, axis=1).max()) for p_SC in points)


def object_axis(reach: HandReach) -> FloatArray:
    """The direction in P of a long object that lies in the hand, shape (3,).

    It is as perpendicular as possible to the directions from the grip region to the fingertips, which press on the
    object, and to the palm, which would be in its way. If the fingers cannot close on such a rod, a direction in which
    they can is returned.
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
        raise InvalidInputError("hand must have collision geometry on its palm, to keep the object out.")
    middle: FloatArray = centres.mean(axis=0)
    return middle


def _unit(v: FloatArray) -> FloatArray:
    unit: FloatArray = v / max(float(np.linalg.norm(v)), 1e-9)
    return unit


def _transform(X: RigidTransform) -> Transform:
    """A pose as in a scenario's file, rounded to 0.01 degrees and 0.1 mm."""
    angles = np.round(np.degrees(RollPitchYaw(X.rotation()).vector()), 2)
    return Transform(translation=np.round(X.translation(), 4), rotation=Rotation(value=Rotation.Rpy(deg=angles)))
