"""Motors heavy enough for the simulator's time step.

Models of hands mostly leave out what their motors' rotors weigh at the joints, though through the gears that is most of
a finger's inertia. Without it, a spring at a fingertip's joint swings faster than the simulator steps; and of joints in
a row, each of which has inertia enough while the others stand still, there is a motion of all that has not.
"""

from collections.abc import Sequence

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import Context

from tactopose_drake.core.grasping.serial_chain import SLIDING_ARM
from tactopose_drake.core.validation import FloatArray
from tactopose_drake.hand.hand_in_plant import Hand, make_hand_plant
from tactopose_drake.systems.grasp_controller import GraspControllerParams

_SHARE = 0.5  # of what the spring and damper do in a step, which a joint's inertia and damping must at least be
_POSTURES = 20  # at which the inertia of all joints together is asked for, beside the one at zero


def add_motor_inertia(plant: MultibodyPlant, hand: Hand, params: GraspControllerParams) -> dict[str, float]:
    """Gives a hand's motors the inertia that the grasp controller needs of them, where the model has less.

    Args:
        plant: not finalized yet.
        hand: the hand in it.
        params: the controller's gains.

    Returns:
        What was added, kg m^2 or kg, by the joint's name.
    """
    alone, parts = make_hand_plant(hand.config)
    names = list(dict.fromkeys(name for finger in hand.config.fingers for name in finger.joints))
    joints = [alone.GetJointByName(name, parts.model_instance) for name in names]
    arm = np.array([SLIDING_ARM if joint.type_name() == "prismatic" else 1.0 for joint in joints])
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
        of_hand[name].set_default_rotor_inertia(of_hand[name].default_rotor_inertia() + more)
        of_hand[name].set_default_gear_ratio(1.0)
    return added


def _inertias(plant: MultibodyPlant, hand: Hand, names: Sequence[str]) -> FloatArray:
    """The inertia against the named joints, coupled ones following, at zero and in other postures, shape (n, k, k)."""
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
