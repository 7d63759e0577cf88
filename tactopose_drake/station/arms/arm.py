"""An arm's configuration, adding an arm to a plant, and mounting a hand on it."""

import dataclasses
from pathlib import Path

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Frame, ModelInstanceIndex, SpatialInertia

from tactopose_drake.core.validation import FloatArray, finite_array, known_name, positive_number, told_of
from tactopose_drake.errors import InvalidFileError, InvalidInputError
from tactopose_drake.hand.hand_in_plant import Hand, joint_to_world
from tactopose_drake.resources import add_model, load_typed_yaml, make_parser, model_path, named_file


@dataclasses.dataclass(kw_only=True, slots=True)
class ArmConfig:
    """An arm's model file and the names in it."""

    model: str = ""  # URL, or path from this file's folder, of an SDF or URDF file with limits of all joints' speeds
    base_link: str = ""  # the link that stands on the ground
    flange_frame: str = ""  # F, the frame or link that carries the hand's base
    # A ball that contains the parts of the arm near the hand, for any position of its last joints: its centre in F, m,
    # and its radius, m; 0: there is none.
    p_FWrist: list[float] = dataclasses.field(default_factory=lambda: [0.0, 0.0, 0.0])
    wrist_radius: float = 0.0

    def validate(self) -> None:
        """Raises InvalidInputError if a name is missing, or a number is invalid."""
        for name in ("model", "base_link", "flange_frame"):
            if not getattr(self, name):
                raise InvalidInputError(f"ArmConfig.{name} must be a name, not empty.")
        finite_array("ArmConfig.p_FWrist", self.p_FWrist, (3,))
        positive_number("ArmConfig.wrist_radius", self.wrist_radius, allow_zero=True)


@dataclasses.dataclass(frozen=True)
class Arm:
    """An arm in a plant."""

    config: ArmConfig
    model_instance: ModelInstanceIndex
    flange: Frame


def load_arm_config(name_or_path: str | Path) -> ArmConfig:
    """Reads a `*.arm.yaml`: one of the package's arms by name, or any file by path.

    Raises:
        InvalidFileError: if the file cannot be read or does not fit `ArmConfig`, or a name is missing.
    """
    path = named_file(name_or_path, "arms", model_path("arms").glob("*/*.arm.yaml"), ".arm.yaml")
    config = load_typed_yaml(ArmConfig, path)
    with told_of(f"{path}: ", InvalidFileError):
        config.validate()
    if "://" not in config.model:
        config.model = str(path.parent / config.model)
    return config


def add_arm(plant: MultibodyPlant, config: ArmConfig, X_WBase: RigidTransform) -> Arm:
    """Parses an arm into a plant that is not finalized yet, and welds its base to the world.

    Raises:
        InvalidFileError: if Drake cannot read the model.
        UnknownNameError: if the model lacks a name of the configuration.
    """
    config.validate()
    instance = add_model(make_parser(plant), config.model)
    frames = {plant.get_frame(index).name(): plant.get_frame(index) for index in plant.GetFrameIndices(instance)}
    for name in (config.base_link, config.flange_frame):
        known_name("each frame of the arm", name, sorted(frames))
    plant.WeldFrames(plant.world_frame(), frames[config.base_link], X_WBase)
    return Arm(config, instance, frames[config.flange_frame])


def mount_hand(plant: MultibodyPlant, arm: Arm, hand: Hand, X_FBase: RigidTransform) -> None:
    """Welds a hand, which was added without `X_WBase`, to an arm's flange.

    Raises:
        InvalidInputError: if the hand's model fixes it to the world.
    """
    joint = joint_to_world(plant, hand)
    if joint is not None:
        raise InvalidInputError(
            f"{hand.config.model} must be a model without the joint {joint.name()!r} on an arm, as it fixes "
            f"{hand.config.base_link!r} to the world."
        )
    plant.WeldFrames(arm.flange, plant.GetFrameByName(hand.config.base_link, hand.model_instance), X_FBase)


def make_arm_plant(
    config: ArmConfig, X_WBase: RigidTransform, payload: SpatialInertia | None = None
) -> tuple[MultibodyPlant, Arm]:
    """Makes a finalized plant of the arm alone, for control and kinematics.

    Args:
        config: the arm's configuration.
        X_WBase: pose of its base.
        payload: spatial inertia of what it carries, as one rigid body about the flange's origin, in the flange's axes.
    """
    plant = MultibodyPlant(time_step=0.0)
    arm = add_arm(plant, config, X_WBase)
    if payload is not None:
        body = plant.AddRigidBody("payload", arm.model_instance, payload)
        plant.WeldFrames(arm.flange, body.body_frame())
    plant.Finalize()
    return plant, arm


def hand_inertia(plant: MultibodyPlant, arm: Arm, hand: Hand, q_hand: FloatArray) -> SpatialInertia:
    """Spatial inertia of the hand as one rigid body about the flange's origin, in the flange's axes.

    Args:
        plant: finalized plant in which the hand is mounted on the arm.
        arm: the arm in it.
        hand: the hand in it.
        q_hand: positions of the hand's joints, shape (nq,), rad.
    """
    context = plant.CreateDefaultContext()
    plant.SetPositions(context, hand.model_instance, np.asarray(q_hand))
    return plant.CalcSpatialInertia(context, arm.flange, plant.GetBodyIndices(hand.model_instance))
