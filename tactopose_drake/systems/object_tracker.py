"""The belief of a held object's pose in a plain loop, without a diagram of one's own."""

import dataclasses
from collections.abc import Mapping
from types import NoneType
from typing import NoReturn

import numpy as np
from numpy.typing import ArrayLike
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform

from tactopose_drake.core.geometry_checks import pose_matrix
from tactopose_drake.core.parameter_checks import params_of
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.tracking.frame import PoseMeasurement
from tactopose_drake.core.tracking.pose_belief import PoseBelief
from tactopose_drake.core.validation import LATEST, FloatArray, instance_of, known_name, number_array, positive_number
from tactopose_drake.errors import InvalidInputError
from tactopose_drake.estimation.prior import PosePrior
from tactopose_drake.estimation.results import PoseEstimate
from tactopose_drake.hand.hand_config import HandConfig
from tactopose_drake.hand.hand_in_plant import make_hand_plant
from tactopose_drake.hand.named_joints import NamedJoints
from tactopose_drake.systems.pose_tracking import MakePoseTracking, PoseTrackingParams


class ObjectTracker:
    """Keeps the belief of a held object's pose: each call with a reading of the hand's senses returns the next belief.

    It wraps the diagram of `AddPoseTracking`; the readings' times are its clock. Sensor faults do not raise but appear
    in the belief's status: a finger with NaN or without a reading, joints that are unknown or read far beyond their
    limits, a clock that goes back. Programming errors raise before anything changes: a name that the hand lacks, a
    wrong shape, text in place of numbers.

    Attributes:
        diagram: the diagram of `MakePoseTracking`.
        context: its context, with the last reading at the input ports and the belief in the state; use it to evaluate
            the diagram's other output ports.
        joint_names: the order of joint positions that are given without names.
    """

    def __init__(self, hand: HandConfig, model: ObjectModel, params: PoseTrackingParams | None = None) -> None:
        """Builds the diagram, which takes about a second.

        Args:
            hand: the hand's names, fingertips and model.
            model: the object.
            params: parameters of each part. Each call of `update` makes a belief and runs the refinement, so the
                periods, `latency` and `live` are ignored.
        """
        params = params_of(PoseTrackingParams, params)
        belief = dataclasses.replace(params.belief, latency=0.0)
        self.diagram = MakePoseTracking(hand, model, dataclasses.replace(params, belief=belief, live=False))
        self.context = self.diagram.CreateDefaultContext()
        self._joints = NamedJoints(*make_hand_plant(hand))
        self.joint_names = self._joints.names
        parts = ["pose_belief", "offset_refiner", "fingertip_inertia"]  # in the order of their updates
        self._advancing = [
            self.diagram.GetSubsystemByName(name) for name in parts if self.diagram.HasSubsystemNamed(name)
        ]
        ports = [self.diagram.get_input_port(index) for index in range(self.diagram.num_input_ports())]
        self._sizes = {
            kind: {port.get_name()[len(kind) + 1 :]: port.size() for port in ports if port.get_name().startswith(kind)}
            for kind in ("wrench", "pressures")
        }

    def __reduce__(self) -> NoReturn:
        raise TypeError(
            "an ObjectTracker cannot be copied or pickled; make another one from hand and model, or pickle its beliefs"
        )

    def update(
        self,
        wrenches: Mapping[str, ArrayLike | None],
        joints: Mapping[str, float] | ArrayLike,
        time: float,
        *,
        pressures: Mapping[str, ArrayLike | None] | None = None,
        joint_velocities: Mapping[str, float] | ArrayLike | None = None,
        vision: PoseMeasurement | PosePrior | None = None,
        palm_pose: RigidTransform | ArrayLike | None = None,
    ) -> PoseBelief:
        """Updates the belief with one reading.

        Args:
            wrenches: F_S on each fingertip by finger, shape (6,): [m_x, m_y, m_z, f_x, f_y, f_z], N m and N. A finger
                that is None, NaN or left out has no reading, which is not the same as no contact.
            joints: positions by the joints' names, or all in the order of `joint_names`, rad; NaN where unknown.
            time: time of the reading by any nonnegative clock, s. A clock that goes back starts a new belief, which the
                status says.
            pressures: of each pad's cells by pad, Pa; missing readings as in `wrenches`.
            joint_velocities: as `joints`, rad/s; the object is taken to move with the fingertips. Without them it is
                taken to move with the palm, and the remarks say so.
            vision: the object's pose from a camera or another guess; None if there is no new one.
            palm_pose: X_WP if known: an object that nothing touches then stays behind in the world. It holds until
                another one is given; a pose with a NaN makes it unknown again.

        Returns:
            The belief; `status` and `remarks` say how far it can be trusted, and `message` combines them.

        Raises:
            InvalidInputError: for a name that the hand lacks, a wrong shape, a value that is not a number, or a time
                that is negative or not finite; the belief then does not change.
        """
        values: dict[str, FloatArray] = {
            **self._readings("wrench", "wrenches", wrenches),
            **self._readings("pressures", "pressures", {} if pressures is None else pressures),
            "joint_positions": self._joints.positions("joints", joints),
        }
        # Velocities that are left out are unknown; those of the last reading no longer hold.
        velocities = self._joints.velocities("joint_velocities", {} if joint_velocities is None else joint_velocities)
        if self.diagram.HasInputPort("joint_velocities"):
            values["joint_velocities"] = velocities
        time = positive_number("time", time, allow_zero=True, most=LATEST)
        instance_of("vision", vision, PoseMeasurement, PosePrior, NoneType)
        objects: dict[str, object] = {"vision": vision}
        if palm_pose is not None:
            objects["palm_pose"] = _palm_pose(palm_pose)
        self.context.SetTime(time)
        for name, value in values.items():
            self.diagram.GetInputPort(name).FixValue(self.context, value)
        for name, given in objects.items():
            self.diagram.GetInputPort(name).FixValue(self.context, AbstractValue.Make(given))
        for system in self._advancing:
            system.advance(system.GetMyMutableContextFromRoot(self.context))
        belief: PoseBelief = self.diagram.GetOutputPort("belief").Eval(self.context)
        return belief

    @property
    def estimate(self) -> PoseEstimate | None:
        """The belief's modes as hypotheses, by falling probability; None before the first pose."""
        estimate: PoseEstimate | None = self.diagram.GetOutputPort("hypotheses").Eval(self.context)
        return estimate

    def _readings(self, kind: str, argument: str, given: Mapping[str, ArrayLike | None]) -> dict[str, FloatArray]:
        """The values for all input ports of a kind ("wrench" or "pressures"), by port name."""
        sizes = self._sizes[kind]
        instance_of(argument, given, Mapping)
        if given and not sizes:
            parts = {"wrench": "force-torque sensors", "pressures": "tactile pads"}[kind]
            raise InvalidInputError(
                f"{argument} must be left out, as the hand has no {parts}, not be given for {list(given)}."
            )
        values = {f"{kind}_{name}": np.full(size, np.nan) for name, size in sizes.items()}
        for name, value in given.items():
            known_name(f"each name in {argument}", name, sizes)
            if value is not None:
                values[f"{kind}_{name}"] = number_array(f"{argument}[{name}]", value, (sizes[name],))
        return values


def _palm_pose(given: RigidTransform | ArrayLike) -> RigidTransform:
    """The palm's pose; its position is NaN if any of its numbers is."""
    matrix = (
        given.GetAsMatrix34() if isinstance(given, RigidTransform) else number_array("palm_pose", given, (3, 4), (4, 4))
    )
    if np.isnan(matrix).any():
        return RigidTransform(np.full(3, np.nan))
    return RigidTransform(pose_matrix("palm_pose", given))
