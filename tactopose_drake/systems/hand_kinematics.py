"""A hand's kinematics within a system, at the joint positions of one of its input ports."""

from pydrake.common.value import AbstractValue
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Frame
from pydrake.systems.framework import Context, InputPort, LeafSystem

from tactopose_drake.hand.kinematics import HandKinematics
from tactopose_drake.systems.collectable_system import CachedValue, declare_cache


def declare_kinematics(system: LeafSystem, plant: MultibodyPlant, frame: Frame, positions: InputPort) -> CachedValue:
    """Declares a cache entry of a system that holds a `HandKinematics`.

    Args:
        system: the system that owns the entry.
        plant: finalized plant of the hand alone.
        frame: frame in which everything is expressed.
        positions: the system's port of the joint positions; NaN where one is unknown. A position far beyond its limits
            counts as unknown, too.
    """

    def move(context: Context, cached: AbstractValue) -> None:
        cached.get_mutable_value().move_to_readings(positions.Eval(context))

    return declare_cache(
        system,
        "kinematics of the hand",
        AbstractValue.Make(HandKinematics(plant, frame)).Clone,
        move,
        {positions.ticket()},
    )
