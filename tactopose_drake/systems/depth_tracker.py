"""A tracker of the object in depth images, with latency, wrong answers and dropouts."""

import dataclasses

import numpy as np
from pydrake.common import RandomDistribution
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.framework import Context, EventStatus, State
from pydrake.systems.sensors import ImageDepth32F

from tactopose_drake.core.parameter_checks import params_of
from tactopose_drake.core.poses import compose, inverse, random_rotations
from tactopose_drake.core.times import has_passed, offset_of_delayed
from tactopose_drake.core.tracking.frame import PoseMeasurement
from tactopose_drake.core.validation import FloatArray, positive_number
from tactopose_drake.core.vision.depth_hypotheses import TrackedPoses, track_poses
from tactopose_drake.core.vision.depth_pictures import DepthCameraModel, take_picture
from tactopose_drake.core.vision.depth_tracking import DepthTrackerModel
from tactopose_drake.estimation.prior import PosePrior
from tactopose_drake.systems.camera_view import CameraView
from tactopose_drake.systems.collectable_system import CollectableSystem
from tactopose_drake.systems.depth_camera import depth_of
from tactopose_drake.systems.ports import eval_input
from tactopose_drake.systems.sample_time import SampleTime
from tactopose_drake.visualization.body_meshes import BodyMeshes

# Standard deviation of a wrong answer's error along each axis, m.
_WRONG = 0.3


@dataclasses.dataclass(kw_only=True, slots=True)
class DepthTrackerParams:
    """Parameters of camera and tracker, and the faults that they simulate."""

    camera: DepthCameraModel = dataclasses.field(default_factory=DepthCameraModel)
    model: DepthTrackerModel = dataclasses.field(default_factory=DepthTrackerModel)
    period: float = 0.1  # s between two pictures
    latency: float = 0.0  # s from a picture to the pose in it
    wrong_share: float = 0.0  # share of answers with an arbitrary pose and the usual covariance
    missing_share: float = 0.0  # share of pictures without an answer
    frozen_from: float | None = None  # time from which on the last picture is repeated, s; None: never

    def validate(self) -> None:
        """Raises InvalidInputError if a value is out of its range."""
        self.camera.validate()
        self.model.validate()
        positive_number("DepthTrackerParams.period", self.period)
        positive_number("DepthTrackerParams.latency", self.latency, allow_zero=True)
        for name in ("wrong_share", "missing_share"):
            positive_number(f"DepthTrackerParams.{name}", getattr(self, name), allow_zero=True, most=1.0)
        if self.frozen_from is not None:
            positive_number("DepthTrackerParams.frozen_from", self.frozen_from, allow_zero=True)


@dataclasses.dataclass(frozen=True, eq=False)
class _TrackerState:
    """Poses of the last fit (None: lost), answers with the times at which they are due, and the published one."""

    tracked: TrackedPoses | None = None
    waiting: tuple[tuple[float, PoseMeasurement | None], ...] = ()
    measurement: PoseMeasurement | None = None
    hidden_share: float = 0.0


class DepthTracker(CollectableSystem):
    """Fits the object's model to the part of it that the hand leaves visible in the images of a depth camera.

    It uses the images alone: it searches the whole image at first and whenever it has lost the object, and tracks the
    object from then on. Where several poses agree with the images about equally well, as those of a mug whose handle
    is hidden, it tracks them all, and the covariance covers all of them.

    .. pydrake_system::

        name: DepthTracker
        input_ports:
        - depth_image
        - body_poses
        - noise
        output_ports:
        - vision
        - prior
        - hidden_share
        - pose_in_world

    - depth_image: `ImageDepth32F`, m, of `AddDepthCamera` or a real camera; 0 or infinite where nothing is seen; read
      at each picture.
    - body_poses: list of `RigidTransform` X_WB, the plant's port of that name; read at each picture. It gives the poses
      of the robot's own bodies; the object's pose is not used.
    - noise: random input, eight standard normal numbers (`AddRandomInputs` connects it), the seed of the faults.
    - vision: `PoseMeasurement` X_PO in the palm, with the time of its picture, or None where the tracker has no
      answer; changes `latency` after each picture. If the clock is set back, the tracker begins anew. Your own tracker
      can replace this one by giving this type.
    - prior: the same as a `PosePrior`, at least as wide; None likewise.
    - hidden_share: size 1, the share of the object's pixels, at the last pose found, that are occluded by something
      nearer, 0 to 1.
    - pose_in_world: `RigidTransform` X_WO of the last picture's fit, or None.
    """

    def __init__(
        self,
        view: CameraView,
        *,
        others: tuple[ModelInstanceIndex, ...] = (),
        params: DepthTrackerParams | None = None,
    ) -> None:
        """Takes numbers and shapes from a finalized plant; keeps no reference to it.

        Args:
            view: object, hand and camera.
            others: further model instances whose pixels count as the hand's, such as an arm or a table.
            params: parameters of camera, tracker and faults.
        """
        super().__init__()
        self._params = params_of(DepthTrackerParams, params)
        self._object_model = view.object_model
        hiding = (view.palm_frame.model_instance(), *others) if self._params.model.knows_hand else ()
        self._hiding = BodyMeshes.from_inspector(view.plant, view.inspector, *hiding)
        self._palm = int(view.palm_frame.body().index())
        self._X_BP = view.palm_frame.GetFixedPoseInBodyFrame()
        self._X_WC = view.X_WC

        self._image = self.DeclareAbstractInputPort("depth_image", AbstractValue.Make(ImageDepth32F()))
        self._body_poses = self.DeclareAbstractInputPort("body_poses", AbstractValue.Make([RigidTransform()]))
        self._noise = self.DeclareVectorInputPort("noise", 8, RandomDistribution.kGaussian)
        self._state = self.DeclareAbstractState(AbstractValue.Make(_TrackerState()))
        ticket = {self.abstract_state_ticket(self._state)}
        period = self._params.period
        self._sampled = SampleTime(self)
        self.DeclarePeriodicUnrestrictedUpdateEvent(period, 0.0, self._take_picture)
        # If delivery coincides with a picture, that event delivers: of two simultaneous updates only one would count.
        if (offset := offset_of_delayed(self._params.latency, period)) > 0.0:
            self.DeclarePeriodicUnrestrictedUpdateEvent(period, offset, self._deliver)
        self.declare_output("vision", None, lambda context: self._get(context).measurement, ticket)
        self.declare_output("prior", None, self._prior, ticket)
        self.declare_output("pose_in_world", None, self._pose_in_world, ticket)
        self.declare_output("hidden_share", 1, lambda context: [self._get(context).hidden_share], ticket)

    def _take_picture(self, context: Context, state: State) -> EventStatus:
        self._sampled.note(context, state)
        params, before, time = self._params, self._get(context), context.get_time()
        X_WB = eval_input(self._body_poses, context, list)
        generator = np.random.default_rng(np.abs(self._noise.Eval(context)).view(np.uint64))
        X_CW, after = self._X_WC.inverse(), before
        if params.frozen_from is None or time < params.frozen_from:
            depth = depth_of(eval_input(self._image, context, ImageDepth32F))
            after = self._track(before, depth, [X_CW @ X for X in X_WB])
        X_CP = (X_CW @ X_WB[self._palm] @ self._X_BP).GetAsMatrix34()
        waiting = (*before.waiting, (time + params.latency, self._answer(after.tracked, X_CP, time, generator)))
        state.get_mutable_abstract_state(self._state).set_value(
            _delivered(dataclasses.replace(after, waiting=waiting), time)
        )
        return EventStatus.Succeeded()

    def _track(self, before: _TrackerState, depth: FloatArray, X_CB: list[RigidTransform]) -> _TrackerState:
        """One picture's fit."""
        hiding = self._hiding.merged(X_CB)
        picture = take_picture(depth, hiding.vertices, hiding.faces, self._params.camera)
        tracked = track_poses(picture, self._object_model, before.tracked, self._params.model)
        hidden_share = 1.0 if tracked is None else tracked.best.hidden_share
        return dataclasses.replace(before, tracked=tracked, hidden_share=hidden_share)

    def _answer(
        self, tracked: TrackedPoses | None, X_CP: FloatArray, time: float, generator: np.random.Generator
    ) -> PoseMeasurement | None:
        """The tracker's answer in the palm, with the simulated faults."""
        wrong, missing = generator.random(2)
        if tracked is None or missing < self._params.missing_share:
            return None
        X_PC = inverse(X_CP)
        X_PO = compose(X_PC, tracked.best.X_CO)
        if wrong < self._params.wrong_share:
            X_PO = np.column_stack([random_rotations(generator, 1)[0], X_PO[:, 3] + _WRONG * generator.normal(size=3)])
        turn = np.eye(6)  # rotates the increment's translation from C to P
        turn[3:, 3:] = X_PC[:, :3]
        covariance = turn @ tracked.covariance @ turn.T
        return PoseMeasurement(time, X_PO, 0.5 * (covariance + covariance.T))

    def _deliver(self, context: Context, state: State) -> EventStatus:
        delivered = _delivered(self._get(context), context.get_time())
        state.get_mutable_abstract_state(self._state).set_value(delivered)
        return EventStatus.Succeeded()

    def _get(self, context: Context) -> _TrackerState:
        value: _TrackerState = context.get_abstract_state(self._state).get_value()
        return value

    def _prior(self, context: Context) -> PosePrior | None:
        measurement = self._get(context).measurement
        return None if measurement is None else PosePrior.of(measurement.as_prior())

    def _pose_in_world(self, context: Context) -> RigidTransform | None:
        tracked = self._get(context).tracked
        return None if tracked is None else self._X_WC @ RigidTransform(tracked.best.X_CO)


def _delivered(state: _TrackerState, time: float) -> _TrackerState:
    """The state after the answers that are due by now have been published."""
    arrived = [answer for due, answer in state.waiting if has_passed(time, due, 0.0)]
    if not arrived:
        return state
    waiting = tuple(entry for entry in state.waiting if not has_passed(time, entry[0], 0.0))
    return dataclasses.replace(state, waiting=waiting, measurement=arrived[-1])
