"""Exploration of a held object by touch until its pose is known, as a sub-diagram."""

import dataclasses
from typing import NamedTuple

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import Diagram, DiagramBuilder

from tactopose_drake.core.parameter_checks import check_parts, params_of
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.errors import InvalidInputError
from tactopose_drake.hand.contact_uncertainty import ContactUncertainty
from tactopose_drake.hand.geometry import BodySpheres
from tactopose_drake.hand.hand_config import HandConfig
from tactopose_drake.hand.hand_in_plant import Hand, make_hand_plant
from tactopose_drake.hand.joint_matrices import reading_offsets
from tactopose_drake.systems.hand_volume import HandVolume
from tactopose_drake.systems.measured_joints import MeasuredJoints
from tactopose_drake.systems.next_touch_chooser import NextTouchChooser, NextTouchParams
from tactopose_drake.systems.ports import check_name_is_free
from tactopose_drake.systems.pose_estimator import PoseEstimator, PoseEstimatorParams
from tactopose_drake.systems.touch_explorer import TouchExplorer, TouchExplorerParams
from tactopose_drake.systems.touch_sensing import export_joints


@dataclasses.dataclass(kw_only=True, slots=True)
class TouchExplorationParams:
    """The parameters of each part."""

    estimator: PoseEstimatorParams = dataclasses.field(default_factory=lambda: PoseEstimatorParams(period=0.2))
    chooser: NextTouchParams = dataclasses.field(default_factory=NextTouchParams)
    explorer: TouchExplorerParams = dataclasses.field(default_factory=TouchExplorerParams)

    def validate(self) -> None:
        """Raises InvalidInputError if a value is out of its range."""
        check_parts(self, estimator=PoseEstimatorParams, chooser=NextTouchParams, explorer=TouchExplorerParams)
        if self.estimator.balance:
            raise InvalidInputError(
                "TouchExplorationParams.estimator.balance must be False, not True, because touches of several instants "
                "do not balance."
            )


def AddTouchExploration(
    builder: DiagramBuilder,
    hand: HandConfig,
    model: ObjectModel,
    params: TouchExplorationParams | None = None,
    name: str = "touch_exploration",
) -> Diagram:
    """Adds the exploration of a held object by touch to a diagram.

    The fingers that hold the object stay. One free finger at a time touches it where that is most informative, and the
    pose is estimated from all touches so far, until one pose is probable enough.

    .. pydrake_system::

        name: touch_exploration
        input_ports:
        - contacts
        - fingers_in_contact
        - joint_positions
        - holding
        - prior
        output_ports:
        - object_pose
        - hypotheses
        - status
        - next_touch
        - resolved
        - touch_status
        - rest_positions
        - touches
        - phase
        - count

    - contacts, fingers_in_contact: outputs of `AddPoseEstimation` or `AddPoseTracking`.
    - joint_positions: measured positions of the hand's joints, in the order of a plant of the hand alone, rad.
    - holding: shape (1,), above 0 once the hand holds the object.
    - prior: `PosePrior` X_PO; may stay unconnected if the method needs none.
    - object_pose, hypotheses, status: see `PoseEstimator`; from all touches so far.
    - next_touch, resolved, touch_status (`status` there): see `NextTouchChooser`.
    - rest_positions, touches, phase, count: see `TouchExplorer`. rest_positions are desired encoder readings of the
      joints that do not hold the object, for the input of that name of `GraspController`.

    Args:
        builder: receives the diagram.
        hand: the hand's names, fingertips and model.
        model: the object.
        params: parameters of each part.
        name: name of the added diagram.

    Returns:
        The diagram; connect its ports by name.

    Raises:
        InvalidInputError: if a parameter is out of its range, or another system of the builder has the name.
    """
    check_name_is_free(builder, name)
    params = params_of(TouchExplorationParams, params)
    inner = DiagramBuilder()
    plant, parts = make_hand_plant(hand)
    systems = _add_systems(inner, plant, parts, model, params)
    _connect(inner, systems)
    _export_inputs(inner, plant, parts, systems)
    _export_outputs(inner, plant, parts, systems)
    return builder.AddNamedSystem(name, inner.Build())


class _Systems(NamedTuple):
    estimator: PoseEstimator
    chooser: NextTouchChooser
    explorer: TouchExplorer
    volume: HandVolume


def _add_systems(
    inner: DiagramBuilder, plant: MultibodyPlant, hand: Hand, model: ObjectModel, params: TouchExplorationParams
) -> _Systems:
    told = hand.config.uncertainty
    errors = None if told is None else ContactUncertainty(plant, hand, told)
    return _Systems(
        inner.AddNamedSystem("pose_estimator", PoseEstimator(model, params.estimator)),
        inner.AddNamedSystem("next_touch_chooser", NextTouchChooser(hand.config, model, params.chooser)),
        inner.AddNamedSystem("touch_explorer", TouchExplorer(hand.config, params.explorer)),
        inner.AddNamedSystem("hand_volume", HandVolume(plant, hand, BodySpheres.of_hand(hand.config), errors)),
    )


def _connect(inner: DiagramBuilder, systems: _Systems) -> None:
    """Connects the systems with each other."""
    estimator, chooser, explorer, volume = systems
    for source, port, taker, taken in (
        (explorer, "touches", estimator, "contacts"),
        (explorer, "untouched", estimator, "untouched"),
        (volume, "hand", estimator, "hand"),
        (estimator, "hypotheses", chooser, "hypotheses"),
        (estimator, "status", chooser, "hypotheses_status"),
        (explorer, "deciding", chooser, "deciding"),
        (chooser, "next_touch", explorer, "next_touch"),
    ):
        inner.Connect(source.GetOutputPort(port), taker.GetInputPort(taken))


def _export_inputs(inner: DiagramBuilder, plant: MultibodyPlant, hand: Hand, systems: _Systems) -> None:
    for name in ("contacts", "fingers_in_contact"):
        inner.ExportInput(systems.chooser.GetInputPort(name), name)
        inner.ConnectInput(name, systems.explorer.GetInputPort(name))
    export_joints(inner, plant, hand, (systems.chooser, systems.explorer, systems.volume))
    inner.ExportInput(systems.explorer.GetInputPort("holding"), "holding")
    inner.ExportInput(systems.estimator.GetInputPort("prior"), "prior")


def _export_outputs(inner: DiagramBuilder, plant: MultibodyPlant, hand: Hand, systems: _Systems) -> None:
    estimator, chooser, explorer, _ = systems
    rest = explorer.GetOutputPort("rest_positions")
    if hand.calibration is not None:  # The explorer outputs true positions; the controller needs encoder readings.
        readings = MeasuredJoints(np.eye(plant.num_positions()), reading_offsets(plant, hand))
        read = inner.AddNamedSystem("rest_readings", readings)
        inner.Connect(rest, read.GetInputPort("measured"))
        rest = read.GetOutputPort("joint_positions")
    for port, called in (
        *((estimator.GetOutputPort(name), name) for name in ("object_pose", "hypotheses", "status")),
        *((chooser.GetOutputPort(name), name) for name in ("next_touch", "resolved")),
        (chooser.GetOutputPort("status"), "touch_status"),
        (rest, "rest_positions"),
        *((explorer.GetOutputPort(name), name) for name in ("touches", "phase", "count")),
    ):
        inner.ExportOutput(port, called)
