"""The belief of a held object's pose in a plain loop, for whoever has no diagram and wants none."""

import dataclasses
from collections.abc import Mapping
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
from tactopose_drake.core.validation import LATEST, FloatArray, known_name, number_array, positive_number
from tactopose_drake.errors import InvalidInputError
from tactopose_drake.estimation.prior import PosePrior
from tactopose_drake.estimation.results import PoseEstimate
from tactopose_drake.hand.hand_config import HandConfig
from tactopose_drake.hand.hand_in_plant import make_hand_plant
from tactopose_drake.hand.named_joints import NamedJoints
from tactopose_drake.systems.pose_tracking import MakePoseTracking, PoseTrackingParams


class ObjectTracker:
    """Keeps the belief of a held object's pose: one call for each reading of the hand's senses gives the next belief.

    It is the diagram of `AddPoseTracking`, whose clock is the readings'. What a sensor cannot say never raises, but
    stands in the belief's status: a finger with NaN or without a reading, joints that are not known or read what is far
    beyond their limits, a clock that goes back. What can only be a mistake raises before anything is changed: a name
    that the hand lacks, a wrong shape, text.

    Attributes:
        diagram: of `MakePoseTracking`.
        context: its context, where the last reading stands at the ports and the belief in the state: all that the
            diagram's other output ports say is to be had from it.
        joint_names: the order of joint positions that are given without names.
    """

    def __init__(self, hand: HandConfig, model: ObjectModel, params: PoseTrackingParams | None = None) -> None:
        """Makes the diagram, in about a second.

        Args:
            hand: the hand's names, fingertips and model.
            model: the object.
            params: parameters of each part; there is a belief whenever `update` is called, and `refinement` looks at
                it, so that their periods, the latency and `live` count for nothing.
        """
        params = params_of(PoseTrackingParams, params)
        belief = dataclasses.replace(params.belief, latency=0.0)
        self.diagram = MakePoseTracking(hand, model, dataclasses.replace(params, belief=belief, live=False))
        self.context = self.diagram.CreateDefaultContext()
        self._joints = NamedJoints(*make_hand_plant(hand))
        self.joint_names = self._joints.names
        parts = ["pose_belief"] if params.refinement is None else ["pose_belief", "offset_refiner"]
        self._advancing = [self.diagram.GetSubsystemByName(name) for name in parts]
        ports = [self.diagram.get_input_port(index) for index in range(self.diagram.num_input_ports())]
        self._sizes = {
            kind: {port.get_name()[len(kind) + 1 :]: port.size() for port in ports if port.get_name().startswith(kind)}
            for kind in ("wrench", "pressures")
        }

    def __reduce__(self) -> NoReturn:
        raise TypeError(
            "an ObjectTracker is neither copied nor pickled: make one for each use, of hand and model; its beliefs are"
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
        """The belief by one more reading.

        Args:
            wrenches: F_S on each fingertip by finger, shape (6,): [m_x, m_y, m_z, f_x, f_y, f_z], N m and N. A finger
                that is None, NaN or left out has no reading, which is not the same as no contact.
            joints: positions by the joints' names, or all in the order of `joint_names`, rad; NaN where not known.
            time: when that was so, s of any clock that does not begin below 0. One that goes back begins a new belief,
                which the status says.
            pressures: of each pad's cells by pad, Pa; likewise.
            joint_velocities: as `joints`, rad/s: the object moves with the fingertips. Without them, with the palm,
                which the remarks say.
            vision: the object's pose by a camera or another guess; None where there is no new one.
            palm_pose: X_WP where it is known: an object that nothing touches then stays behind in the world. It stays
                what it was until another is given; one with a NaN says that it is not known any more.

        Returns:
            The belief; `status` and `remarks` say how far it can be trusted, and `message` both.

        Raises:
            InvalidInputError: for a name that the hand lacks, a shape that does not fit, what is not a number, or a
                time that is not finite; the belief is then what it was.
        """
        values: dict[str, FloatArray] = {
            **self._readings("wrench", "wrenches", wrenches),
            **self._readings("pressures", "pressures", {} if pressures is None else pressures),
            "joint_positions": self._joints.positions("joints", joints),
        }
        # None is known of velocities that are left out: those of the last reading say nothing of now.
        velocities = self._joints.velocities("joint_velocities", {} if joint_velocities is None else joint_velocities)
        if self.diagram.HasInputPort("joint_velocities"):
            values["joint_velocities"] = velocities
        time = positive_number("time", time, allow_zero=True, most=LATEST)
        if vision is not None and not isinstance(vision, PoseMeasurement | PosePrior):
            raise InvalidInputError(
                f"vision: is a {type(vision).__name__}; allowed are PoseMeasurement, PosePrior and None."
            )
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
        """The values of all ports of a kind, by port."""
        sizes = self._sizes[kind]
        if not isinstance(given, Mapping):
            raise InvalidInputError(f"{argument}: is a {type(given).__name__}; allowed is a mapping by name.")
        if given and not sizes:
            parts = {"wrench": "force-torque sensors", "pressures": "tactile pads"}[kind]
            raise InvalidInputError(f"{argument}: are of {list(given)}, but the hand has no {parts}; allowed are none.")
        values = {f"{kind}_{name}": np.full(size, np.nan) for name, size in sizes.items()}
        for name, value in given.items():
            known_name(argument, name, sizes)
            if value is not None:
                values[f"{kind}_{name}"] = number_array(f"{argument}[{name}]", value, (sizes[name],))
        return values


def _palm_pose(given: RigidTransform | ArrayLike) -> RigidTransform:
    """The palm's pose; one with a NaN in place of its position where some number of it is not known."""
    matrix = (
        given.GetAsMatrix34() if isinstance(given, RigidTransform) else number_array("palm_pose", given, (3, 4), (4, 4))
    )
    if np.isnan(matrix).any():
        return RigidTransform(np.full(3, np.nan))
    return RigidTransform(pose_matrix("palm_pose", given))
