"""A Meshcat display of contacts and pose estimates, as a system."""

import dataclasses

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.geometry import Meshcat
from pydrake.math import RigidTransform
from pydrake.multibody.tree import Frame, RigidBody
from pydrake.systems.framework import Context, EventStatus

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.parameter_checks import params_of
from tactopose_drake.core.sensing.patches import Patch
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import instance_of, positive_number, whole_number
from tactopose_drake.errors import InvalidInputError, PortTypeError
from tactopose_drake.estimation.prior import PosePrior
from tactopose_drake.estimation.results import PoseEstimate
from tactopose_drake.systems.collectable_system import CollectableSystem
from tactopose_drake.systems.ports import eval_input, eval_items, eval_optional_input, port_name
from tactopose_drake.visualization.appearance import MOST_ALTERNATIVES, MOVING_ALTERNATIVES
from tactopose_drake.visualization.frame_marks import add_frames
from tactopose_drake.visualization.meshcat import aim_camera, check_meshcat
from tactopose_drake.visualization.patch_marks import add_patches, move_patches
from tactopose_drake.visualization.pose_marks import add_hypotheses, add_object, move_hypotheses, place
from tactopose_drake.visualization.scene import Scene, ShownHypothesis, false_contacts, touch_of, worth_drawing
from tactopose_drake.visualization.touch_marks import add_touch, move_touch

_MARGIN = 2.2  # of the camera's view, wide enough for the hand around the object and for estimates beside it


@dataclasses.dataclass(kw_only=True, slots=True)
class PoseDisplayParams:
    """What is displayed, and how often."""

    period: float = 1.0 / 32.0  # s between two frames
    path: str = "/tactopose"  # of all parts in Meshcat's tree; two displays in one Meshcat need different paths
    max_contacts: int = 10  # contacts that can be shown at once
    friction_coefficient: float | None = None  # of the friction cones; None: no cones are shown
    aim_camera: bool = True  # whether to aim the camera at the object once, when a simulation is initialized
    max_alternatives: int = MOVING_ALTERNATIVES  # hypotheses beside the best that can be shown at once, 0 to 5
    max_pads: int = 4  # tactile pads whose pressed cells can be shown at once
    max_cells: int = 24  # cells of each pad that can be shown
    frames: bool = False  # whether the frames of palm and object are shown

    def validate(self) -> None:
        """Raises InvalidInputError if a value is out of its range."""
        positive_number("PoseDisplayParams.period", self.period)
        instance_of("PoseDisplayParams.path", self.path, str)
        if self.path.strip("/") in ("", "drake"):  # The display deletes its path; Meshcat's own parts are in these.
            raise InvalidInputError(
                f"PoseDisplayParams.path must be one of its own, such as /tactopose, not {self.path!r}, which is the "
                "parent of other parts."
            )
        for name in ("max_contacts", "max_pads", "max_cells"):
            whole_number(f"PoseDisplayParams.{name}", getattr(self, name), least=0)
        if self.friction_coefficient is not None:
            positive_number("PoseDisplayParams.friction_coefficient", self.friction_coefficient)
        whole_number("PoseDisplayParams.max_alternatives", self.max_alternatives, least=0, most=MOST_ALTERNATIVES)


class PoseDisplay(CollectableSystem):
    """Shows contacts with their forces and normals, and the object at the prior and the estimate.

    With `hypotheses` it also shows the estimate's uncertainty and free directions, which contacts are probably false,
    and other hypotheses.

    .. pydrake_system::

        name: PoseDisplay
        input_ports:
        - contacts
        - patches
        - prior
        - object_pose
        - hypotheses
        - body_poses

    - contacts: `Contacts` in P.
    - patches: tuple of `Patch` in P; may stay unconnected. Their centres are shown as contacts, their pressed cells as
      plates whose size grows with the pressure, their principal axes as bars.
    - prior: `PosePrior` X_PO or None; nothing is shown for it when it is not connected or None.
    - object_pose: `RigidTransform` X_PO, the estimate.
    - hypotheses: `PoseEstimate` or None (no estimate); replaces `object_pose` if it is connected.
    - body_poses: list of `RigidTransform` X_WB, the plant's port of that name, for the palm; P is Meshcat's world when
      it is not connected.

    All inputs are read once a period, and at a `ForcedPublish`, which needs no simulation. The display is part of
    Meshcat's recording when one is running.
    """

    def __init__(
        self,
        meshcat: Meshcat,
        model: ObjectModel,
        palm_frame: Frame | None = None,
        params: PoseDisplayParams | None = None,
        object_body: RigidBody | None = None,
    ) -> None:
        """Keeps a reference to the display; its parts are created when a simulation is initialized.

        Args:
            meshcat: the display.
            model: the object.
            palm_frame: P in the plant of `body_poses`; needed when that is connected.
            params: what to show.
            object_body: the object in the plant of `body_poses`, whose true pose is shown as a wire frame: as a solid,
                a simulated object would hide the estimate.
        """
        super().__init__()
        check_meshcat(meshcat)
        instance_of("model", model, ObjectModel)
        self._params = params_of(PoseDisplayParams, params)
        self._meshcat, self._model = meshcat, model
        self._palm_body = None if palm_frame is None else int(palm_frame.body().index())
        self._object_body = None if object_body is None else int(object_body.index())
        self._X_BP = RigidTransform() if palm_frame is None else palm_frame.GetFixedPoseInBodyFrame()
        self._contacts = self.DeclareAbstractInputPort("contacts", AbstractValue.Make(Contacts.empty()))
        self._patches = self.DeclareAbstractInputPort("patches", AbstractValue.Make(()))
        self._prior = self.DeclareAbstractInputPort("prior", AbstractValue.Make(None))
        self._pose = self.DeclareAbstractInputPort("object_pose", AbstractValue.Make(RigidTransform()))
        self._hypotheses = self.DeclareAbstractInputPort("hypotheses", AbstractValue.Make(None))
        self._body_poses = self.DeclareAbstractInputPort("body_poses", AbstractValue.Make([RigidTransform()]))
        self.DeclareInitializationPublishEvent(self._make_parts)
        self.DeclarePeriodicPublishEvent(self._params.period, 0.0, self._move_parts)
        self.DeclareForcedPublishEvent(self._move_parts)

    def _make_parts(self, context: Context) -> EventStatus:
        path, params = self._params.path, self._params
        self._meshcat.Delete(path)
        add_object(self._meshcat, f"{path}/prior", self._model, "prior")
        if self._object_body is not None:
            add_object(self._meshcat, f"{path}/truth", self._model, "truth")
        add_hypotheses(self._meshcat, path, self._model, params.max_alternatives)
        add_touch(self._meshcat, f"{path}/touch", params.max_contacts, friction=params.friction_coefficient)
        if self._patches.HasValue(context):
            add_patches(self._meshcat, f"{path}/patches", params.max_pads, params.max_cells)
        if params.frames:
            add_frames(self._meshcat, path)
        if params.aim_camera:
            self._aim(context)
        return EventStatus.Succeeded()

    def _aim(self, context: Context) -> None:
        prior, X_WP = eval_optional_input(self._prior, context, PosePrior), self._palm_pose(context)
        scene = Scene(
            model=self._model,
            contacts=self._touch(context)[0],
            hypotheses=self._shown(context),
            prior=None if prior is None else prior.X_PO,
            truth=self._true_pose(context, X_WP),
            up_P=X_WP.rotation().inverse() @ np.array([0.0, 0.0, 1.0]),
        )
        aim_camera(self._meshcat, scene, X_WP, stage=False, margin=_MARGIN)

    def _move_parts(self, context: Context) -> EventStatus:
        path, time, meshcat = self._params.path, context.get_time(), self._meshcat
        if not meshcat.HasPath(path):  # No simulation was initialized, or somebody has deleted the parts.
            self._make_parts(context)
        X_WP = self._palm_pose(context)
        meshcat.SetTransform(path, X_WP, time)
        prior = eval_optional_input(self._prior, context, PosePrior)
        place(meshcat, f"{path}/prior", None if prior is None else prior.X_PO, time)
        if self._object_body is not None:
            place(meshcat, f"{path}/truth", self._true_pose(context, X_WP), time)
        (contacts, patches), params = self._touch(context), self._params
        hypotheses = self._shown(context)
        move_hypotheses(meshcat, path, self._model, hypotheses, params.max_alternatives, time)
        is_false = false_contacts(hypotheses, len(contacts), patches)
        move_touch(meshcat, f"{path}/touch", contacts, params.max_contacts, time, is_false)
        if self._patches.HasValue(context):
            move_patches(meshcat, f"{path}/patches", patches, params.max_pads, params.max_cells, time)
        return EventStatus.Succeeded()

    def _touch(self, context: Context) -> tuple[Contacts, tuple[Patch, ...]]:
        """The contacts, joined with the centres of the patches, and the patches."""
        patches = eval_items(self._patches, context, Patch)
        return touch_of(eval_input(self._contacts, context, Contacts), patches), patches

    def _shown(self, context: Context) -> tuple[ShownHypothesis, ...]:
        if not self._hypotheses.HasValue(context):
            return (ShownHypothesis(eval_input(self._pose, context, RigidTransform)),)
        estimate = eval_optional_input(self._hypotheses, context, PoseEstimate)
        if estimate is None:
            return ()
        return worth_drawing([ShownHypothesis.of(hypothesis) for hypothesis in estimate.hypotheses])

    def _true_pose(self, context: Context, X_WP: RigidTransform) -> RigidTransform | None:
        """X_PO in the simulation; None without a simulated object."""
        X_WB = eval_optional_input(self._body_poses, context, list)
        return None if X_WB is None or self._object_body is None else X_WP.inverse() @ X_WB[self._object_body]

    def _palm_pose(self, context: Context) -> RigidTransform:
        X_WB = eval_optional_input(self._body_poses, context, list)
        if X_WB is None:
            return RigidTransform()
        if self._palm_body is None:
            raise PortTypeError(
                f"{port_name(self._body_poses)} must not be connected to a display without a palm_frame, but is."
            )
        return X_WB[self._palm_body] @ self._X_BP
