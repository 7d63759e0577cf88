"""The Meshcat display of a touch and of what is made of it, as a system."""

import dataclasses

from pydrake.common.value import AbstractValue
from pydrake.geometry import Meshcat
from pydrake.math import RigidTransform
from pydrake.multibody.tree import Frame
from pydrake.systems.framework import Context, EventStatus

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import positive_number
from tactopose_drake.errors import InvalidInputError
from tactopose_drake.estimation.prior import PosePrior
from tactopose_drake.systems.collectable_system import CollectableSystem
from tactopose_drake.systems.ports import eval_input, eval_optional_input
from tactopose_drake.visualization.meshcat import add_object, add_touch, move_touch


@dataclasses.dataclass(kw_only=True, slots=True)
class PoseDisplayParams:
    """What is displayed, and how often."""

    period: float = 1.0 / 32.0  # s between two frames
    path: str = "/tactopose"  # of all parts in Meshcat's tree
    max_contacts: int = 10  # that can be shown at once
    friction_coefficient: float | None = 0.6  # of the friction cones; no cones without
    estimate_opacity: float = 0.6  # 0 to 1; the object itself is mostly shown too

    def validate(self) -> None:
        """Raises InvalidInputError if a value is out of its range."""
        positive_number("PoseDisplayParams.period", self.period)
        if self.max_contacts < 0:
            raise InvalidInputError(
                f"PoseDisplayParams.max_contacts: is {self.max_contacts}; allowed are numbers >= 0."
            )
        if self.friction_coefficient is not None:
            positive_number("PoseDisplayParams.friction_coefficient", self.friction_coefficient)
        if not 0.0 <= self.estimate_opacity <= 1.0:
            raise InvalidInputError(
                f"PoseDisplayParams.estimate_opacity: is {self.estimate_opacity:g}; allowed are numbers from 0 to 1."
            )


class PoseDisplay(CollectableSystem):
    """Shows contacts with their forces, normals and friction cones, and the object at the prior and the estimate.

    .. pydrake_system::

        name: PoseDisplay
        input_ports:
        - contacts
        - prior
        - object_pose
        - body_poses

    - contacts: `Contacts` in P.
    - prior: `PosePrior` X_PO or None; nothing is shown for it when it is not connected or None.
    - object_pose: `RigidTransform` X_PO, the estimate.
    - body_poses: list of `RigidTransform` X_WB, the plant's port of that name, for the palm; P is Meshcat's world when
      it is not connected.

    All are read once a period. What is shown goes into Meshcat's recording when there is one.
    """

    def __init__(
        self,
        meshcat: Meshcat,
        model: ObjectModel,
        palm_frame: Frame | None = None,
        params: PoseDisplayParams | None = None,
    ) -> None:
        """Keeps a reference to the display; the parts are made when a simulation is initialized.

        Args:
            meshcat: the display.
            model: the object.
            palm_frame: P in the plant of `body_poses`; needed when that is connected.
            params: what to show.
        """
        super().__init__()
        self._params = PoseDisplayParams() if params is None else params
        self._params.validate()
        self._meshcat, self._model = meshcat, model
        self._palm_body = None if palm_frame is None else int(palm_frame.body().index())
        self._X_BP = RigidTransform() if palm_frame is None else palm_frame.GetFixedPoseInBodyFrame()
        self._contacts = self.DeclareAbstractInputPort("contacts", AbstractValue.Make(Contacts.empty()))
        self._prior = self.DeclareAbstractInputPort("prior", AbstractValue.Make(None))
        self._pose = self.DeclareAbstractInputPort("object_pose", AbstractValue.Make(RigidTransform()))
        self._body_poses = self.DeclareAbstractInputPort("body_poses", AbstractValue.Make([RigidTransform()]))
        self.DeclareInitializationPublishEvent(self._make_parts)
        self.DeclarePeriodicPublishEvent(self._params.period, 0.0, self._move_parts)

    def _make_parts(self, context: Context) -> EventStatus:
        path, params = self._params.path, self._params
        self._meshcat.Delete(path)
        add_object(self._meshcat, f"{path}/prior", self._model, "prior")
        add_object(self._meshcat, f"{path}/estimate", self._model, "estimate", params.estimate_opacity)
        add_touch(self._meshcat, f"{path}/touch", params.max_contacts, friction=params.friction_coefficient)
        return EventStatus.Succeeded()

    def _move_parts(self, context: Context) -> EventStatus:
        path, time = self._params.path, context.get_time()
        self._meshcat.SetTransform(path, self._palm_pose(context), time)
        prior = eval_optional_input(self._prior, context, PosePrior)
        self._meshcat.SetProperty(f"{path}/prior", "visible", prior is not None, time)
        if prior is not None:
            self._meshcat.SetTransform(f"{path}/prior", prior.X_PO, time)
        self._meshcat.SetTransform(f"{path}/estimate", eval_input(self._pose, context, RigidTransform), time)
        contacts = eval_input(self._contacts, context, Contacts)
        move_touch(self._meshcat, f"{path}/touch", contacts, self._params.max_contacts, time)
        return EventStatus.Succeeded()

    def _palm_pose(self, context: Context) -> RigidTransform:
        X_WB = eval_optional_input(self._body_poses, context, list)
        if X_WB is None or self._palm_body is None:
            return RigidTransform()
        return X_WB[self._palm_body] @ self._X_BP
