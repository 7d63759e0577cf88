"""A simulated vision source: the object's pose with an error that grows with occlusion by the hand."""

import dataclasses

import numpy as np
from pydrake.common import RandomDistribution
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.systems.framework import Context, EventStatus, State

from tactopose_drake.core.posterior.moved_origin import has_far_origin, move_origin, prior_of_middle
from tactopose_drake.core.validation import positive_number
from tactopose_drake.core.vision.vision_model import VisionModel, hidden_share, measure_pose, tail_stretch
from tactopose_drake.estimation.prior import PosePrior
from tactopose_drake.hand.geometry import BodySpheres
from tactopose_drake.systems.camera_view import CameraView
from tactopose_drake.systems.collectable_system import CollectableSystem
from tactopose_drake.systems.ports import eval_input
from tactopose_drake.systems.sample_time import SampleTime

# Surface points that are tested for occlusion; the standard error of the hidden share is then below 3 %.
_POINTS = 400


@dataclasses.dataclass(kw_only=True, slots=True)
class SimulatedVisionParams:
    """Size of the error and frame rate."""

    model: VisionModel = dataclasses.field(default_factory=VisionModel)
    period: float = 0.5  # s between two frames

    def validate(self) -> None:
        """Raises InvalidInputError if a value is out of its range."""
        self.model.validate()
        positive_number("SimulatedVisionParams.period", self.period)


class SimulatedVision(CollectableSystem):
    """Estimates the object's pose as a camera would: the true pose with an error that grows with occlusion.

    .. pydrake_system::

        name: SimulatedVision
        input_ports:
        - body_poses
        - noise
        - tail
        output_ports:
        - prior
        - hidden_share

    - body_poses: list of `RigidTransform` X_WB, the plant's port of that name; read at each frame.
    - noise: random input, six standard normal numbers (`AddRandomInputs` connects it): the directions of the error.
    - tail: random input, a standard normal number that scales the error for heavy tails; the port exists only with
      `degrees_of_freedom`.
    - prior: `PosePrior` X_PO; changes at each frame, first at t = 0; None before, also once
      the clock has been set back.
    - hidden_share: size 1, the share of the object's camera side that the hand hides, 0 to 1; changes with `prior`.
    """

    def __init__(
        self, view: CameraView, params: SimulatedVisionParams, degrees_of_freedom: float | None = None
    ) -> None:
        """Takes numbers from a finalized plant; keeps no reference to it.

        Args:
            view: object, hand and camera, whose field of view is not limited.
            params: size of the error and frame rate.
            degrees_of_freedom: of heavy tails: the error is multiplied by the factor that turns a Gaussian one into one
                of Student's t distribution; None: its length is that of the model, as the prior says.
        """
        super().__init__()
        params.validate()
        self._model = params.model
        self._spheres = BodySpheres.from_inspector(view.plant, view.inspector, view.palm_frame.model_instance())
        self._object, self._palm = int(view.object_body.index()), int(view.palm_frame.body().index())
        self._X_BP = view.palm_frame.GetFixedPoseInBodyFrame()
        self._X_CW = view.X_WC.inverse()
        samples = view.object_model.samples
        chosen = np.linspace(0, len(samples.points) - 1, _POINTS).astype(int)
        # The error turns a far object about its middle, and a prior's sigmas are taken for those of the middle.
        self._p_OM = view.object_model.middle if has_far_origin(view.object_model) else np.zeros(3)
        self._p_OQ, self._n_OQ = samples.points[chosen], samples.normals[chosen]

        self._body_poses = self.DeclareAbstractInputPort("body_poses", AbstractValue.Make([RigidTransform()]))
        self._noise = self.DeclareVectorInputPort("noise", 6, RandomDistribution.kGaussian)
        self._degrees_of_freedom, self._tail = degrees_of_freedom, None
        if degrees_of_freedom is not None:
            positive_number("degrees_of_freedom", degrees_of_freedom)
            self._tail = self.DeclareVectorInputPort("tail", 1, RandomDistribution.kGaussian)
        self._prior = self.DeclareAbstractState(AbstractValue.Make(None))
        self._hidden = self.DeclareDiscreteState(np.zeros(1))
        self._sampled = SampleTime(self)
        self.DeclarePeriodicUnrestrictedUpdateEvent(params.period, 0.0, self._take_frame)
        self.DeclareStateOutputPort("prior", self._prior)
        self.DeclareStateOutputPort("hidden_share", self._hidden)

    def _take_frame(self, context: Context, state: State) -> EventStatus:
        self._sampled.note(context, state)
        X_WB = eval_input(self._body_poses, context, list)
        X_CO = self._X_CW @ X_WB[self._object]
        hidden = hidden_share(
            X_CO.multiply(self._p_OQ.T).T,
            X_CO.rotation().multiply(self._n_OQ.T).T,
            self._X_CW.multiply(self._spheres.positions(X_WB).T).T,
            self._spheres.radius,
        )
        X_PO = (X_WB[self._palm] @ self._X_BP).inverse() @ X_WB[self._object]
        stretch = 1.0
        if self._tail is not None and self._degrees_of_freedom is not None:
            stretch = tail_stretch(float(self._tail.Eval(context)[0]), self._degrees_of_freedom)
        X_PM = move_origin(X_PO.GetAsMatrix34(), self._p_OM)
        seen = prior_of_middle(measure_pose(X_PM, hidden, self._noise.Eval(context), self._model, stretch), -self._p_OM)
        state.get_mutable_abstract_state(self._prior).set_value(PosePrior.of(seen))
        state.get_mutable_discrete_state(self._hidden).SetFromVector([hidden])
        return EventStatus.Succeeded()
