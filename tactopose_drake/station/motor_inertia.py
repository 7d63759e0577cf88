"""Motors heavy enough for the simulator's time step.

Models of hands mostly leave out what their motors' rotors weigh at the joints, though through the gears that is most of
a finger's inertia. Without it, a spring at a fingertip's joint swings faster than the simulator steps.
"""

import numpy as np
from pydrake.multibody.plant import MultibodyPlant

from tactopose_drake.core.grasping.serial_chain import SLIDING_ARM
from tactopose_drake.hand.hand_config import Hand, make_hand_plant
from tactopose_drake.systems.grasp_controller import GraspControllerParams

_SHARE = 0.5  # of what the spring and damper do in a step, which a joint's inertia and damping must at least be


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
    context = alone.CreateDefaultContext()
    inertia = np.diag(alone.CalcMassMatrix(context))
    step, added = plant.time_step(), {}
    for name in dict.fromkeys(name for finger in hand.config.fingers for name in finger.joints):
        joint = alone.GetJointByName(name, parts.model_instance)
        arm = SLIDING_ARM if joint.type_name() == "prismatic" else 1.0
        has = inertia[joint.velocity_start()] + step * joint.default_damping_vector()[0]
        spring = step * params.finger_stiffness + params.finger_damping
        lack = _SHARE * step * spring / arm**2 - has
        if lack > 0.0:
            actuator = next(
                actuator
                for actuator in map(plant.get_joint_actuator, plant.GetJointActuatorIndices())
                if actuator.joint().name() == name and actuator.model_instance() == hand.model_instance
            )
            actuator.set_default_rotor_inertia(actuator.default_rotor_inertia() + lack)
            actuator.set_default_gear_ratio(1.0)
            added[name] = float(lack)
    return added
