"""A sub-diagram from wrenches, pad pressures and joint positions to the object's pose."""

import dataclasses

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import Diagram, DiagramBuilder

from tactopose_drake.core.parameter_checks import check_parts, params_of
from tactopose_drake.core.plain_values import numbers
from tactopose_drake.core.sensing.force_torque import GRAVITY_W
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import instance_of
from tactopose_drake.errors import InvalidInputError
from tactopose_drake.hand.collision import HandCollision
from tactopose_drake.hand.hand_config import HandConfig
from tactopose_drake.hand.hand_in_plant import Hand, make_hand_plant
from tactopose_drake.systems.plant_senses import add_with_plant, told_hand
from tactopose_drake.systems.pose_estimator import PoseEstimator, PoseEstimatorParams
from tactopose_drake.systems.touch_sensing import TouchParams, add_touch

_MOST_OTHER_GRAVITY = 0.05  # m/s^2; on the earth it differs by less


@dataclasses.dataclass(kw_only=True, slots=True)
class PoseEstimationParams(TouchParams):
    """The parameters of each part."""

    estimator: PoseEstimatorParams = dataclasses.field(default_factory=PoseEstimatorParams)

    def validate(self) -> None:
        """Raises InvalidInputError if a value is out of its range."""
        TouchParams.validate(self)
        check_parts(self, estimator=PoseEstimatorParams)


def AddPoseEstimation(
    builder: DiagramBuilder,
    hand: HandConfig,
    model: ObjectModel,
    params: PoseEstimationParams | None = None,
    name: str = "pose_estimation",
    *,
    plant: MultibodyPlant | Hand | None = None,
    simulated_senses: bool = True,
) -> Diagram:
    """Adds the estimation of a held object's pose to a diagram.

    .. pydrake_system::

        name: pose_estimation
        input_ports:
        - wrench_<finger>
        - pressures_<pad>
        - age_<pad>
        - joint_positions
        - prior
        - planes
        - palm_pose
        output_ports:
        - object_pose
        - hypotheses
        - status
        - contacts
        - fingers_in_contact
        - contact_status
        - contact_solutions
        - patches
        - pads
        - patch_status

    - wrench_<finger>: one per finger of the hand, F_S on the fingertip about its sensor's origin, as a sensor measures
      it: [m_x, m_y, m_z, f_x, f_y, f_z], N m and N; NaN: no reading. This and the next two may stay unconnected.
    - pressures_<pad>: one per tactile pad of the hand, pressures of its cells, Pa; NaN where there is no reading.
    - age_<pad>: age of those pressures, s; an old frame is ignored.
    - joint_positions: measured positions of the hand's joints, in the order of a plant of the hand alone, rad.
    - prior: `PosePrior` X_PO; may stay unconnected if the method needs none.
    - planes (may stay unconnected), palm_pose (exists only with `balance`), object_pose, hypotheses, status: see
      `PoseEstimator`.
    - contact_solutions: see `ContactSolver`.
    - contacts, fingers_in_contact, contact_status (`status` there): see `ContactsInPalm`.
    - patches, pads, patch_status (`status` there): see `PatchDescriptor`; only if the hand has pads.

    Args:
        builder: receives the diagram.
        hand: the hand's names, fingertips and model; its kinematics are computed in a plant of its own.
        model: the object.
        params: parameters of each part.
        name: name of the added diagram.
        plant: finalized plant in the same builder that holds the hand; joint positions and palm pose are connected to
            it. If it holds several such hands, pass the one that `add_hand` returned.
        simulated_senses: whether wrenches are simulated from the plant's reaction forces, and pressures from its
            contacts. A calibration in the hand's file is then ignored, as it belongs to a real hand. The plant's
            gravity must not change afterwards, since the sensors subtract the fingertips' weights.

    Returns:
        The diagram; connect its remaining ports by name.

    Raises:
        InvalidInputError: if a parameter is out of its range, another system of the builder has the name, or the plant
            is not finalized, is not in the builder, does not hold exactly one such hand, or with `balance` has another
            gravity than the earth's along -z.
    """
    hand = told_hand(hand, plant, simulated_senses)
    estimation = MakePoseEstimation(hand, model, params)
    if plant is not None and params is not None and params.estimator.balance:
        _check_gravity(plant)
    return add_with_plant(builder, name, estimation, hand, plant, simulated_senses)


def MakePoseEstimation(hand: HandConfig, model: ObjectModel, params: PoseEstimationParams | None = None) -> Diagram:
    """Builds the diagram that `AddPoseEstimation` adds."""
    instance_of("hand", hand, HandConfig)
    instance_of("model", model, ObjectModel)
    params = params_of(PoseEstimationParams, params)
    builder = DiagramBuilder()
    collision = HandCollision(hand, model) if params.check_collisions else None
    estimating = PoseEstimator(model, params.estimator, collision, len(hand.pads))
    estimator = builder.AddNamedSystem("pose_estimator", estimating)
    add_touch(builder, *make_hand_plant(hand), params, estimator, collision=collision)
    for port in ("prior", "planes", *(("palm_pose",) if params.estimator.balance else ())):
        builder.ExportInput(estimator.GetInputPort(port), port)
    diagram = builder.Build()
    diagram.set_name("pose_estimation")
    return diagram


def _check_gravity(place: MultibodyPlant | Hand) -> None:
    """Raises InvalidInputError unless the plant's gravity is the one that the balance of forces assumes."""
    plant = place.palm_frame.GetParentPlant() if isinstance(place, Hand) else place
    instance_of("plant", plant, MultibodyPlant)
    gravity = plant.gravity_field().gravity_vector()
    if np.linalg.norm(gravity - GRAVITY_W) > _MOST_OTHER_GRAVITY:
        raise InvalidInputError(
            f"plant must have a gravity of {numbers(GRAVITY_W, 2)} m/s^2 with PoseEstimatorParams.balance, not "
            f"{numbers(gravity, 2)} m/s^2."
        )
