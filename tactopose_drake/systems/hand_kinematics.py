"""A hand's kinematics within a system, at the joint positions that one of its ports has."""

from pydrake.common.value import AbstractValue
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Frame
from pydrake.systems.framework import CacheEntry, Context, InputPort, LeafSystem, ValueProducer

from tactopose_drake.hand.kinematics import HandKinematics


def declare_kinematics(system: LeafSystem, plant: MultibodyPlant, frame: Frame, positions: InputPort) -> CacheEntry:
    """Declares a cache entry of a system that holds a `HandKinematics`.

    Args:
        system: whose it is.
        plant: finalized plant of the hand alone.
        frame: that everything is expressed in.
        positions: the system's port of the joint positions; NaN where one is not known.
    """

    def move(context: Context, cached: AbstractValue) -> None:
        cached.get_mutable_value().move(positions.Eval(context))

    return system.DeclareCacheEntry(
        "kinematics of the hand",
        ValueProducer(allocate=AbstractValue.Make(HandKinematics(plant, frame)).Clone, calc=move),
        {positions.ticket()},
    )
