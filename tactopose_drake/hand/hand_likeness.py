"""Check that the hand in a plant has the same geometry as its files; equal names do not ensure that."""

import math

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Frame
from pydrake.systems.framework import Context

from tactopose_drake.errors import InvalidInputError
from tactopose_drake.hand.hand_in_plant import Hand, joints_of

_NEAR, _NEAR_DEG = 1e-4, 0.1  # tolerance of a sensor's pose, m and deg, as files are rounded
_FREE = 1.0  # limit that is assumed for a joint without limits, rad or m


def check_likeness(plant: MultibodyPlant, hand: Hand, alone: MultibodyPlant, hand_alone: Hand) -> None:
    """Compares the poses of sensors and pads in the palm, with all joints at zero, at either limit and halfway.

    Args:
        plant: finalized plant that holds the hand.
        hand: the hand in it.
        alone: plant of the hand alone, without a calibration.
        hand_alone: the hand in that plant.

    Raises:
        InvalidInputError: if a joint is missing or of another type in `plant`, or the pose of a sensor or pad differs.
    """
    here, there = plant.CreateDefaultContext(), alone.CreateDefaultContext()
    for share in (None, 0.0, 0.5, 1.0):
        _move(plant, hand, here, alone, there, share)
        for name, frame in _sensing_frames(hand_alone).items():
            X = plant.CalcRelativeTransform(here, hand.palm_frame, _sensing_frames(hand)[name])
            X_alone = alone.CalcRelativeTransform(there, hand_alone.palm_frame, frame)
            _check_near(name, X_alone.InvertAndCompose(X))


def _sensing_frames(hand: Hand) -> dict[str, Frame]:
    fingers = {f"sensor of finger {name!r}": frame for name, frame in hand.sensor_frames.items()}
    return fingers | {f"pad {name!r}": frame for name, frame in hand.pad_frames.items()}


def _move(
    plant: MultibodyPlant, hand: Hand, here: Context, alone: MultibodyPlant, there: Context, share: float | None
) -> None:
    """Moves the hand's joints in both plants to a share of the range between their limits; None: to zero."""
    names = {joint.name() for joint in joints_of(plant, hand)}
    q, q_alone = plant.GetPositions(here), alone.GetPositions(there)
    for index in alone.GetJointIndices():
        joint = alone.get_joint(index)
        if joint.num_positions() != 1:
            continue
        name, kind = joint.name(), joint.type_name()
        same = plant.GetJointByName(name, hand.model_instance) if name in names else None
        if same is None or same.type_name() != kind:
            given = "but lacks it" if same is None else f"not a {same.type_name()} one"
            raise InvalidInputError(
                f"plant must have the hand's joint {name!r} as a {kind} one, like {hand.config.model}, {given}."
            )
        moved = _at(joint.position_lower_limits()[0], joint.position_upper_limits()[0], share)
        q_alone[joint.position_start()] = q[same.position_start()] = moved
    plant.SetPositions(here, q)
    alone.SetPositions(there, q_alone)


def _at(low: float, high: float, share: float | None) -> float:
    if share is None:
        return 0.0
    low, high = low if math.isfinite(low) else -_FREE, high if math.isfinite(high) else _FREE
    return low + share * (high - low)


def _check_near(name: str, X: RigidTransform) -> None:
    moved, turned = float(np.linalg.norm(X.translation())), math.degrees(X.rotation().ToAngleAxis().angle())
    if moved > _NEAR or turned > _NEAR_DEG:
        raise InvalidInputError(
            f"plant must have the {name} within {1e3 * _NEAR:g} mm and {_NEAR_DEG:g} deg of where the HandConfig's "
            f"model has it in the palm, not {1e3 * moved:.1f} mm and {turned:.1f} deg off. Without `plant=` the ports "
            "can be connected one by one."
        )
