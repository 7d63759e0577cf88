"""Reflected motor inertia that is large enough for the simulator's time step.

Models of hands mostly omit the reflected inertia of the motors' rotors, though through the gears it is most of a
finger's inertia. Without it, the controller's spring at a fingertip's joint oscillates faster than the simulator steps.
For joints in series it is not enough that each has sufficient inertia while the others are fixed: their combined
motions must have it, too.
"""

from collections.abc import Sequence

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import Context

from tactopose_drake.core.validation import FloatArray
from tactopose_drake.hand.hand_in_plant import Hand, make_hand_plant
from tactopose_drake.hand.hand_joints import joint_arms
from tactopose_drake.systems.grasp_controller import GraspControllerParams

_SHARE = 0.5  # least ratio of a joint's inertia and damping to the effect of spring and damper in a step
_POSTURES = 20  # random postures at which the mass matrix is checked, besides zero


def add_motor_inertia(plant: MultibodyPlant, hand: Hand, params: GraspControllerParams) -> dict[str, float]:
    """Increases a hand's motor inertia to what the grasp controller's gains need, where the model has less.

    Args:
        plant: plant that is not finalized yet.
        hand: the hand in it.
        params: the controller's gains.

    Returns:
        The added inertia, kg m^2 or kg, by the joint's name.
    """
    alone, parts = make_hand_plant(hand.config)
    names = hand.config.driven
    joints = [alone.GetJointByName(name, parts.model_instance) for name in names]
    arm = joint_arms(alone, parts, names)
    step = plant.time_step()
    damping = step * np.array([joint.default_damping_vector()[0] for joint in joints])
    needed = _SHARE * step * (step * params.finger_stiffness + params.finger_damping) / arm**2
    inertias = _inertias(alone, parts, names) + np.diag(damping)
    lack = np.maximum(needed - np.diag(inertias[0]), 0.0)
    scale = np.sqrt(needed)
    least = np.linalg.eigvalsh((inertias + np.diag(lack)) / np.outer(scale, scale))[:, 0].min()
    lack += max(1.0 - float(least), 0.0) * needed
    actuators = [plant.get_joint_actuator(index) for index in plant.GetJointActuatorIndices()]
    of_hand = {
        actuator.joint().name(): actuator for actuator in actuators if actuator.model_instance() == hand.model_instance
    }
    added = {name: float(more) for name, more in zip(names, lack, strict=True) if more > 0.0}
    for name, more in added.items():
        of_hand[name].set_default_rotor_inertia(of_hand[name].default_reflected_inertia() + more)
        of_hand[name].set_default_gear_ratio(1.0)
    return added


def _inertias(plant: MultibodyPlant, hand: Hand, names: Sequence[str]) -> FloatArray:
    """Mass matrices of the named joints, including coupled ones, at zero and in other postures, shape (n, k, k)."""
    places = [plant.GetJointByName(name, hand.model_instance).velocity_start() for name in names]
    follow = np.zeros((plant.num_velocities(), len(names)))
    follow[places, np.arange(len(names))] = 1.0
    for joint, coupling in hand.config.couplings.items():
        row, leader = (
            plant.GetJointByName(name, hand.model_instance).velocity_start() for name in (joint, coupling.follows)
        )
        follow[row] = coupling.ratio * follow[leader]
    context = plant.CreateDefaultContext()
    return np.array([follow.T @ inertia @ follow for inertia in _mass_matrices(plant, context)])


def _mass_matrices(plant: MultibodyPlant, context: Context) -> list[FloatArray]:
    generator, matrices = np.random.default_rng(0), [plant.CalcMassMatrix(context)]
    lower = np.maximum(plant.GetPositionLowerLimits(), -np.pi)
    upper = np.minimum(plant.GetPositionUpperLimits(), np.pi)
    for _ in range(_POSTURES):
        plant.SetPositions(context, generator.uniform(lower, upper))
        matrices.append(plant.CalcMassMatrix(context))
    return matrices
