"""What the grasp planner needs to know of a hand, from its model."""

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, MultibodyPlant

from tactopose_drake.core.grasping.finger_reach import FingerGeometry, FingerReach, ReachParams
from tactopose_drake.core.grasping.grasp_planner import HandReach, Spheres
from tactopose_drake.core.surfaces import Capsule, Surface
from tactopose_drake.core.validation import FloatArray
from tactopose_drake.errors import InvalidInputError
from tactopose_drake.hand.finger_chain import finger_chain
from tactopose_drake.hand.geometry import BodySpheres
from tactopose_drake.hand.hand_config import Hand, HandConfig, add_hand
from tactopose_drake.hand.kinematics import HandKinematics
from tactopose_drake.resources import passing_builder

# Samples of a finger's workspace for each of its joints.
_SAMPLES_PER_JOINT = 1200


def make_hand_reach(config: HandConfig, params: ReachParams, seed: int = 0) -> HandReach:
    """Samples what each finger of a hand can reach.

    Args:
        config: the hand; it needs a grip region.
        params: what counts as a clean touch.
        seed: of the samples.

    Raises:
        InvalidInputError: if the hand has no grip region.
    """
    params.validate()
    if not config.grip_low or not config.grip_high:
        raise InvalidInputError(
            "HandConfig.grip_low, grip_high: are empty; planned grasps need the hand's grip region."
        )
    with passing_builder() as builder:
        plant, scene_graph = AddMultibodyPlantSceneGraph(builder, time_step=0.001)
        hand = add_hand(plant, config, RigidTransform())
        plant.Finalize()
    spheres = BodySpheres.from_inspector(plant, scene_graph.model_inspector(), hand.model_instance)
    generator = np.random.default_rng(seed)
    geometries = {finger: _finger_geometry(plant, hand, finger, spheres) for finger in hand.fingers}
    return HandReach(
        {
            name: FingerReach(geometry, params, generator, _SAMPLES_PER_JOINT * len(geometry.chain.lower))
            for name, geometry in geometries.items()
        },
        _palm_spheres(plant, hand, spheres),
        {name: _rest_spheres(geometry, rest_positions(config, name)) for name, geometry in geometries.items()},
        np.array(config.grip_low),
        np.array(config.grip_high),
    )


def rest_positions(config: HandConfig, finger: str) -> FloatArray:
    """Where a finger's actuated joints wait when it takes no part, rad."""
    return np.array([config.rest_positions.get(name, 0.0) for name in config.finger(finger).joints])


def _finger_geometry(plant: MultibodyPlant, hand: Hand, finger: str, spheres: BodySpheres) -> FingerGeometry:
    chain = finger_chain(plant, hand, finger)
    bodies = [int(plant.GetBodyByName(name, hand.model_instance).index()) for name in chain.bodies]
    on_finger = np.isin(spheres.body, bodies)
    place = np.array([bodies.index(body) for body in spheres.body[on_finger]], dtype=np.intp)
    center, radius = _round_end(hand.surfaces[finger])
    return FingerGeometry(chain, center, radius, place, spheres.p_BH[on_finger], spheres.radius[on_finger])


def _round_end(surface: Surface) -> tuple[FloatArray, float]:
    """Centre in S, m, and radius, m, of the sphere that ends a fingertip."""
    height = 0.5 * surface.length if isinstance(surface, Capsule) else 0.0
    p_SF: FloatArray = surface.X_SF[:, 3] + height * surface.X_SF[:, 2]
    return p_SF, surface.half_width


def _palm_spheres(plant: MultibodyPlant, hand: Hand, spheres: BodySpheres) -> Spheres:
    """The spheres that no finger moves, where zero joint positions put them."""
    of_fingers: set[int] = set()
    for finger in hand.fingers:
        chain = finger_chain(plant, hand, finger)
        of_fingers |= {int(plant.GetBodyByName(name, hand.model_instance).index()) for name in chain.bodies}
        of_fingers.add(int(hand.welds[finger].child_body().index()))
    fixed = ~np.isin(spheres.body, sorted(of_fingers))
    return HandKinematics(plant, hand.palm_frame).positions(spheres)[fixed], spheres.radius[fixed]


def _rest_spheres(geometry: FingerGeometry, q: FloatArray) -> Spheres:
    batch = q[None]
    centres = np.concatenate([geometry.spheres(batch)[0], geometry.tip(batch, 0.0), geometry.tip(batch, 1.0)])
    return centres, np.append(geometry.radius, [geometry.tip_radius] * 2)
