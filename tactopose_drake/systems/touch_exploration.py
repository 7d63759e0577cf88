"""From the touch of a hand that holds an object to further touches, until its pose is known."""

import dataclasses
from typing import NamedTuple

from pydrake.systems.framework import Diagram, DiagramBuilder

from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import check_parts, params_of
from tactopose_drake.errors import InvalidInputError
from tactopose_drake.hand.geometry import BodySpheres
from tactopose_drake.hand.hand_config import HandConfig
from tactopose_drake.hand.hand_in_plant import make_hand_plant
from tactopose_drake.systems.hand_volume import HandVolume
from tactopose_drake.systems.next_touch_chooser import NextTouchChooser, NextTouchParams
from tactopose_drake.systems.ports import check_name_is_free
from tactopose_drake.systems.pose_estimator import PoseEstimator, PoseEstimatorParams
from tactopose_drake.systems.touch_explorer import TouchExplorer, TouchExplorerParams


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
                "TouchExplorationParams.estimator.balance: is True; allowed is False, for touches of several instants "
                "do not balance."
            )


def AddTouchExploration(
    builder: DiagramBuilder,
    hand: HandConfig,
    model: ObjectModel,
    params: TouchExplorationParams | None = None,
    name: str = "touch_exploration",
) -> Diagram:
    """Adds what explores a held object by touch to a diagram under construction.

    The fingers that hold the object stay; one free finger after the other feels for it where that tells most, and the
    pose is estimated anew from all that was felt, until enough of the belief is about one pose.

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

    - contacts, fingers_in_contact: of `AddPoseEstimation` or `AddPoseTracking`.
    - joint_positions: measured positions of the hand's joints, in the order of a plant of the hand alone, rad.
    - holding: shape (1,), above 0 once the hand holds the object.
    - prior: `PosePrior` X_PO; may stay unconnected where the method needs none.
    - object_pose, hypotheses, status: of `PoseEstimator`, by all that was felt.
    - next_touch, resolved, touch_status: of `NextTouchChooser` (its `status`).
    - rest_positions, touches, phase, count: of `TouchExplorer`. The first is what the hand's controller is to do with
      the joints that do not hold: `GraspController` has an input of that name.

    Args:
        builder: receives the diagram.
        hand: the hand's names, fingertips and model.
        model: the object.
        params: parameters of each part.
        name: of the diagram in the other.

    Returns:
        The diagram; its ports are to be connected by name.

    Raises:
        InvalidInputError: if a parameter is out of its range, or a system of the builder has the name already.
    """
    check_name_is_free(builder, name)
    params = params_of(TouchExplorationParams, params)
    inner = DiagramBuilder()
    _connect(inner, _add_parts(inner, hand, model, params))
    return builder.AddNamedSystem(name, inner.Build())


class _Parts(NamedTuple):
    estimator: PoseEstimator
    chooser: NextTouchChooser
    explorer: TouchExplorer
    volume: HandVolume


def _add_parts(inner: DiagramBuilder, hand: HandConfig, model: ObjectModel, params: TouchExplorationParams) -> _Parts:
    plant, parts = make_hand_plant(hand)
    return _Parts(
        inner.AddNamedSystem("pose_estimator", PoseEstimator(model, params.estimator)),
        inner.AddNamedSystem("next_touch_chooser", NextTouchChooser(hand, model, params.chooser)),
        inner.AddNamedSystem("touch_explorer", TouchExplorer(hand, params.explorer)),
        inner.AddNamedSystem("hand_volume", HandVolume(plant, parts, BodySpheres.of_hand(hand))),
    )


def _connect(inner: DiagramBuilder, parts: _Parts) -> None:
    """Connects the parts with each other, and gives the diagram its ports."""
    estimator, chooser, explorer, volume = parts
    for source, port, taker, taken in (
        (explorer, "touches", estimator, "contacts"),
        (explorer, "untouched", estimator, "untouched"),
        (volume, "hand", estimator, "hand"),
        (estimator, "hypotheses", chooser, "hypotheses"),
        (explorer, "deciding", chooser, "deciding"),
        (chooser, "next_touch", explorer, "next_touch"),
    ):
        inner.Connect(source.GetOutputPort(port), taker.GetInputPort(taken))
    for name_in, takers in (
        ("contacts", (chooser, explorer)),
        ("fingers_in_contact", (chooser, explorer)),
        ("joint_positions", (chooser, explorer, volume)),
        ("holding", (explorer,)),
        ("prior", (estimator,)),
    ):
        inner.ExportInput(takers[0].GetInputPort(name_in), name_in)
        for taker in takers[1:]:
            inner.ConnectInput(name_in, taker.GetInputPort(name_in))
    for system, port, called in (
        *((estimator, name_out, name_out) for name_out in ("object_pose", "hypotheses", "status")),
        *((chooser, name_out, name_out) for name_out in ("next_touch", "resolved")),
        (chooser, "status", "touch_status"),
        *((explorer, name_out, name_out) for name_out in ("rest_positions", "touches", "phase", "count")),
    ):
        inner.ExportOutput(system.GetOutputPort(port), called)
