"""The geometry and reach of a hand's fingers for the grasp planner, from the hand's model."""

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np
from pydrake.geometry import SceneGraphInspector
from pydrake.math import RotationMatrix
from pydrake.multibody.plant import MultibodyPlant

from tactopose_drake.core import poses
from tactopose_drake.core.grasping.finger_geometry import FingerGeometry
from tactopose_drake.core.grasping.finger_reach import FingerReach, ReachParams
from tactopose_drake.core.grasping.grasp_planner import HandReach
from tactopose_drake.core.grasping.grip_region import find_grip_region
from tactopose_drake.core.grasping.serial_chain import SerialChain
from tactopose_drake.core.shape.sphere_packing import Spheres
from tactopose_drake.core.surfaces import Capsule, Superquadric, Surface
from tactopose_drake.core.surfaces.surface import random_directions
from tactopose_drake.core.validation import FloatArray
from tactopose_drake.errors import InvalidInputError
from tactopose_drake.hand.finger_chain import checked_limits, finger_chain
from tactopose_drake.hand.geometry import BodySpheres, corner_spheres
from tactopose_drake.hand.hand_config import HandConfig
from tactopose_drake.hand.hand_in_plant import Hand, make_hand_with_shapes
from tactopose_drake.hand.hand_joints import HandJoints
from tactopose_drake.hand.kinematics import HandKinematics
from tactopose_drake.hand.shared_joints import with_held_joints

# Samples of a finger's workspace for each of its joints.
_SAMPLES_PER_JOINT = 1200
# If the sensor is nearer to the fingertip's round end than this share of its radius, the axis does not start there.
_LEAST_AXIS = 0.5
_LONGEST_AXIS = 1.5  # longest axis that does not start at the sensor, in radii
_SAME_AXIS = 0.1  # largest angle between a capsule's axis and the direction to its end that count as equal, rad
_MOST_SPHERES = 150  # of a finger
_MOST_PROTRUSION = 0.0015  # by which the fingertip's link may protrude from the fingertip's surface, m
REST_ROUNDING = 1e-3
"""By how much a position in a hand's file may exceed its joint's limit, rad or m."""

_DIRECTIONS = random_directions(np.random.default_rng(0), 64)


def make_hand_reach(config: HandConfig, params: ReachParams) -> HandReach:
    """Samples what each finger of a hand can reach.

    Args:
        config: the hand; if it has no grip region, the region where most of its fingertips can meet is used.
        params: conditions of a clean touch.

    Raises:
        InvalidInputError: if fewer than two fingers have a force-torque sensor, which closing a grasp needs; if one of
            their joints has no limits; or if no place is in reach of two fingers.
    """
    params.validate()
    sensing = config.sensing
    if len(sensing) < 2:
        raise InvalidInputError(
            f"HandConfig.fingers must have a force-torque sensor on 2 or more fingers, not on {len(sensing)}: planned "
            "grasps are closed by their wrenches. Close a hand with other sensors by Scenario.grip."
        )
    plant, inspector, hand = make_hand_with_shapes(config)
    spheres = BodySpheres.from_inspector(plant, inspector, hand.model_instance)
    generator = np.random.default_rng(0)
    geometries = {finger: _finger_geometry(plant, inspector, hand, finger, spheres) for finger in sensing}
    fingers = {
        name: FingerReach(geometry, params, generator, _SAMPLES_PER_JOINT * len(geometry.chain.lower))
        for name, geometry in geometries.items()
    }
    palm = _palm_spheres(plant, hand, spheres)
    low, high = np.array(config.grip_low), np.array(config.grip_high)
    if not config.grip_low:
        low, high = find_grip_region(fingers, palm, params)
    return HandReach(
        fingers,
        palm,
        {name: _rest_spheres(geometry, rest_positions(config, name)) for name, geometry in geometries.items()},
        low,
        high,
    )


def check_rest_positions(plant: MultibodyPlant, hand: Hand) -> None:
    """Checks that the rest positions that a hand's file gives are within their joints' limits.

    Raises:
        InvalidInputError: if one is beyond its limits.
    """
    check_within_limits("HandConfig.rest_positions", hand.config.rest_positions, plant, hand)


def check_within_limits(name: str, positions: Mapping[str, float], plant: MultibodyPlant, hand: Hand) -> None:
    """Checks that joint positions are within the joints' limits, except for rounding.

    Args:
        name: name of the positions in messages.
        positions: positions by the joints' names, which must exist, rad or m.
        plant: the plant that contains the hand.
        hand: the hand in it.

    Raises:
        InvalidInputError: if one is beyond its joint's limits.
    """
    for joint_name, position in positions.items():
        joint = plant.GetJointByName(joint_name, hand.model_instance)
        low, high = joint.position_lower_limits()[0], joint.position_upper_limits()[0]
        if not low - REST_ROUNDING <= position <= high + REST_ROUNDING:
            raise InvalidInputError(
                f"{name}[{joint_name}] must be within the joint's limits, {low:.3g} to {high:.3g}, not {position:g}."
            )


def rest_positions(config: HandConfig, finger: str) -> FloatArray:
    """Rest positions of a finger's actuated joints, for when it takes no part, rad or m."""
    return np.array([config.rest_positions.get(name, 0.0) for name in config.finger(finger).joints])


def rest_posture(
    plant: MultibodyPlant, hand: Hand, waiting: Mapping[str, FloatArray] = MappingProxyType({})
) -> FloatArray:
    """The hand's joint positions with all fingers at rest, shape (nq,), rad, including coupled joints.

    Args:
        plant: plant that holds the hand.
        hand: the hand in it.
        waiting: actuated joint positions, by finger, that replace the rest positions of some fingers.
    """
    joints, q = HandJoints.of(plant, hand), np.zeros(plant.num_positions(hand.model_instance))
    for finger in hand.config.fingers:
        positions = waiting.get(finger.name, rest_positions(hand.config, finger.name))
        for name, position in zip(finger.joints, positions, strict=True):
            q[joints.position[name]] = position
    return joints.with_followers(q, hand.config.couplings)


def _finger_geometry(
    plant: MultibodyPlant, inspector: SceneGraphInspector, hand: Hand, finger: str, spheres: BodySpheres
) -> FingerGeometry:
    chain, surface = finger_chain(plant, hand, finger), hand.surfaces[finger]
    checked_limits(hand.config.finger(finger), chain)
    chain = with_held_joints(chain, hand.config, finger)
    bodies = [int(plant.GetBodyByName(name, hand.model_instance).index()) for name in chain.bodies]
    tip = int(hand.welds[finger].child_body().index())
    corners = corner_spheres(plant, inspector, [body for body in bodies if body != tip])
    spheres = spheres.of(set(bodies) | {tip}).thinned(_MOST_SPHERES).joined(corners)
    on_finger = np.isin(spheres.body, bodies) & (spheres.body != tip)
    place = np.array([bodies.index(body) for body in spheres.body[on_finger]], dtype=np.intp)
    # Parts of the fingertip's link beyond its surface must be clear of the object, like the rest of the finger.
    X_STip = plant.CalcRelativeTransform(
        plant.CreateDefaultContext(), hand.sensor_frames[finger], hand.welds[finger].child_body().body_frame()
    )
    on_tip = spheres.body == tip
    p_SH = X_STip.multiply(spheres.p_BH[on_tip].T).T
    beside = protrusions(surface, p_SH, spheres.radius[on_tip]) > _MOST_PROTRUSION
    p_BH = np.concatenate([spheres.p_BH[on_finger], poses.transform_points(chain.X_last_sensor, p_SH[beside])])
    radius = np.concatenate([spheres.radius[on_finger], spheres.radius[on_tip][beside]])
    place = np.append(place, np.full(np.count_nonzero(beside), len(bodies) - 1, dtype=np.intp))
    form = _as_capsule(chain, surface) if isinstance(surface, Superquadric) else surface
    center, tip_radius = _round_end(form)
    root = _root(chain, form, center, tip_radius)
    return FingerGeometry(chain, center, tip_radius, place, p_BH, radius, root, _start_of_straight_part(form))


def _as_capsule(chain: SerialChain, surface: Superquadric) -> Capsule:
    """The inscribed capsule along a superquadric's longest axis.

    Its round end is the one away from the last joint. The planner plans touches with the capsule, while contacts are
    computed on the superquadric.
    """
    longest = int(np.argmax(surface.semi_axes))
    axis, center = surface.X_SF[:, longest], surface.X_SF[:, 3]
    X_SJ = poses.inverse(poses.compose(chain.X_child[-1], chain.X_last_sensor))
    axis = axis if axis @ (center - X_SJ[:, 3]) >= 0.0 else -axis
    R_SF = RotationMatrix.MakeFromOneVector(axis, 2).matrix()
    length = 2.0 * (surface.semi_axes[longest] - surface.half_width)
    return Capsule(surface.half_width, length, two_ended=True, X_SF=poses.make_poses(R_SF, center))


def protrusions(surface: Surface, p_SH: FloatArray, radius: FloatArray) -> FloatArray:
    """How far spheres at p_SH (n, 3), m, with radii (n,), m, protrude from a fingertip's surface, m, shape (n,)."""
    on_spheres = p_SH[:, None] + radius[:, None, None] * _DIRECTIONS
    gauge = np.sqrt(1.0 + surface.value(on_spheres.reshape(-1, 3))).reshape(len(p_SH), -1)
    farthest: FloatArray = surface.half_width * (gauge.max(axis=1, initial=0.0) - 1.0)
    return farthest


def _root(chain: SerialChain, surface: Surface, p_ST: FloatArray, radius: float) -> FloatArray:
    """The root in S of the fingertip's axis, which ends in p_ST.

    It is on a capsule's own axis; otherwise at the sensor; or, if that is too close to the end, towards the last
    joint's axis.
    """
    length = float(np.linalg.norm(p_ST))
    if isinstance(surface, Capsule) and length * np.cos(_SAME_AXIS) > surface.X_SF[:, 2] @ p_ST:
        return p_ST - min(surface.length, _LONGEST_AXIS * radius) * surface.X_SF[:, 2]
    if length > _LEAST_AXIS * radius:
        return np.zeros(3)
    last = len(chain.bodies) - 1
    if last in chain.sliding:
        return p_ST
    X_SJ = poses.inverse(poses.compose(chain.X_child[last], chain.X_last_sensor))
    axis, p_SJ = X_SJ[:, :3] @ chain.axis[last], X_SJ[:, 3]
    to_axis = p_SJ + axis * (axis @ (p_ST - p_SJ)) - p_ST
    distance = float(np.linalg.norm(to_axis))
    if distance < _LEAST_AXIS * radius:
        return p_ST
    root: FloatArray = p_ST + to_axis * min(1.0, _LONGEST_AXIS * radius / distance)
    return root


def _round_end(surface: Surface) -> tuple[FloatArray, float]:
    """Centre in S, m, and radius, m, of the sphere at the end of a fingertip."""
    height = 0.5 * surface.length if isinstance(surface, Capsule) else 0.0
    p_SF: FloatArray = surface.X_SF[:, 3] + height * surface.X_SF[:, 2]
    return p_SF, surface.half_width


def _start_of_straight_part(surface: Surface) -> FloatArray | None:
    """The start in S of a capsule's cylindrical part, m; None for other fingertips."""
    if not isinstance(surface, Capsule) or not surface.length:
        return None
    start: FloatArray = surface.X_SF[:, 3] - 0.5 * surface.length * surface.X_SF[:, 2]
    return start


def _palm_spheres(plant: MultibodyPlant, hand: Hand, spheres: BodySpheres) -> Spheres:
    """The spheres that no finger moves, at zero joint positions."""
    of_fingers: set[int] = set()
    for finger in hand.welds:
        chain = finger_chain(plant, hand, finger)
        of_fingers |= {int(plant.GetBodyByName(name, hand.model_instance).index()) for name in chain.bodies}
        of_fingers.add(int(hand.welds[finger].child_body().index()))
    fixed = ~np.isin(spheres.body, sorted(of_fingers))
    return HandKinematics(plant, hand.palm_frame).positions(spheres)[fixed], spheres.radius[fixed]


def _rest_spheres(geometry: FingerGeometry, q: FloatArray) -> Spheres:
    batch = q[None]
    centres, radius = geometry.all_spheres(batch)
    return centres[0], radius
