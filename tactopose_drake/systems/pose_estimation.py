"""From wrenches, pads' pressures and joint positions to the object's pose: one diagram to put into another."""

import dataclasses

from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import Diagram, DiagramBuilder

from tactopose_drake.core.parameter_checks import check_parts, params_of
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import instance_of
from tactopose_drake.hand.collision import HandCollision
from tactopose_drake.hand.hand_config import HandConfig
from tactopose_drake.hand.hand_in_plant import Hand, make_hand_plant
from tactopose_drake.systems.plant_senses import add_with_plant, told_hand
from tactopose_drake.systems.pose_estimator import PoseEstimator, PoseEstimatorParams
from tactopose_drake.systems.touch_sensing import TouchParams, add_touch


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
    """Adds the estimation of a held object's pose to a diagram under construction.

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
    - pressures_<pad>: one per tactile pad of the hand, of its cells, Pa; NaN where there is no reading.
    - age_<pad>: of those, s; an old frame counts for nothing.
    - joint_positions: measured, of the hand's joints, in the order of a plant of the hand alone, rad.
    - prior: `PosePrior` X_PO; may stay unconnected where the method needs none.
    - planes, which may stay unconnected, and palm_pose, which is there only with `balance`: of `PoseEstimator`, as are
      object_pose, hypotheses, status; contact_solutions: of `ContactSolver`; contacts, fingers_in_contact,
      contact_status: of `ContactsInPalm` (its `status`).
    - patches, pads, patch_status: of `PatchDescriptor` (its `status`); only where the hand has pads.

    Args:
        builder: receives the diagram.
        hand: the hand's names, fingertips and model; its kinematics are computed in a plant of its own.
        model: the object.
        params: parameters of each part.
        name: of the diagram in the other.
        plant: finalized plant of the same diagram that holds the hand among whatever else: joints and palm are its. Of
            several such hands in it, the one that `add_hand` gave.
        simulated_senses: whether, with a plant, wrenches are of its reaction forces, and pressures of its contacts. A
            calibration in the hand's file, which is of a real hand, then counts for nothing.

    Returns:
        The diagram; all other ports are to be connected by name.

    Raises:
        InvalidInputError: if a parameter is out of its range, a system of the builder has the name already, or the
            plant is not finalized or not the builder's, or holds no such hand, or several.
    """
    hand = told_hand(hand, plant, simulated_senses)
    estimation = MakePoseEstimation(hand, model, params)
    return add_with_plant(builder, name, estimation, hand, plant, simulated_senses)


def MakePoseEstimation(hand: HandConfig, model: ObjectModel, params: PoseEstimationParams | None = None) -> Diagram:
    """The diagram that `AddPoseEstimation` adds, by itself."""
    instance_of("hand", hand, HandConfig)
    instance_of("model", model, ObjectModel)
    params = params_of(PoseEstimationParams, params)
    builder = DiagramBuilder()
    collision = HandCollision(hand, model) if params.check_collisions else None
    estimator = builder.AddNamedSystem("pose_estimator", PoseEstimator(model, params.estimator, collision))
    add_touch(builder, *make_hand_plant(hand), params, estimator, collision=collision)
    for port in ("prior", "planes", *(("palm_pose",) if params.estimator.balance else ())):
        builder.ExportInput(estimator.GetInputPort(port), port)
    diagram = builder.Build()
    diagram.set_name("pose_estimation")
    return diagram
