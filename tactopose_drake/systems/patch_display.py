"""The Meshcat display of what a hand's tactile pads feel, as a system."""

import dataclasses

from pydrake.common.value import AbstractValue
from pydrake.geometry import Meshcat
from pydrake.math import RigidTransform
from pydrake.systems.framework import Context, EventStatus

from tactopose_drake.core.validation import positive_number
from tactopose_drake.errors import InvalidInputError
from tactopose_drake.hand.hand_config import Hand
from tactopose_drake.hand.tactile_pads import load_tactile_pad
from tactopose_drake.systems.collectable_system import CollectableSystem
from tactopose_drake.systems.ports import eval_input, eval_optional_input
from tactopose_drake.visualization.patch_marks import add_patches, move_patches


@dataclasses.dataclass(kw_only=True, slots=True)
class PatchDisplayParams:
    """Where patches are displayed, and how often."""

    period: float = 1.0 / 32.0  # s between two frames
    path: str = "/tactopose_patches"  # of all parts in Meshcat's tree

    def validate(self) -> None:
        """Raises InvalidInputError if the period is not positive."""
        positive_number("PatchDisplayParams.period", self.period)


class PatchDisplay(CollectableSystem):
    """Shows the pressed cells of a hand's pads as plates as large as their pressure, and each patch's principal axes.

    .. pydrake_system::

        name: PatchDisplay
        input_ports:
        - patches
        - body_poses

    - patches: tuple of `Patch` in P.
    - body_poses: list of `RigidTransform` X_WB, the plant's port of that name, for the palm; P is Meshcat's world when
      it is not connected.

    Both are read once a period. What is shown goes into Meshcat's recording when there is one.
    """

    def __init__(self, meshcat: Meshcat, hand: Hand, params: PatchDisplayParams | None = None) -> None:
        """Keeps a reference to the display; the parts are made when a simulation is initialized.

        Args:
            meshcat: the display.
            hand: the hand, in the plant of `body_poses`; its description says how many pads and cells there are.
            params: where and how often.

        Raises:
            InvalidInputError: if the hand has no pads, or an array's file is unusable.
        """
        super().__init__()
        self._params = PatchDisplayParams() if params is None else params
        self._params.validate()
        if not hand.config.pads:
            raise InvalidInputError("hand: has no tactile pads; allowed is a hand whose description names some.")
        self._meshcat = meshcat
        self._slots = len(hand.config.pads)
        self._cells = max(len(load_tactile_pad(pad.array).layout) for pad in hand.config.pads)
        self._palm_body = int(hand.palm_frame.body().index())
        self._X_BP = hand.palm_frame.GetFixedPoseInBodyFrame()
        self._patches = self.DeclareAbstractInputPort("patches", AbstractValue.Make(()))
        self._body_poses = self.DeclareAbstractInputPort("body_poses", AbstractValue.Make([RigidTransform()]))
        self.DeclareInitializationPublishEvent(self._make_parts)
        self.DeclarePeriodicPublishEvent(self._params.period, 0.0, self._move_parts)

    def _make_parts(self, context: Context) -> EventStatus:
        add_patches(self._meshcat, self._params.path, self._slots, self._cells)
        return EventStatus.Succeeded()

    def _move_parts(self, context: Context) -> EventStatus:
        X_WB = eval_optional_input(self._body_poses, context, list)
        X_WP = RigidTransform() if X_WB is None else X_WB[self._palm_body] @ self._X_BP
        self._meshcat.SetTransform(self._params.path, X_WP, context.get_time())
        patches = eval_input(self._patches, context, tuple)
        move_patches(self._meshcat, self._params.path, patches, self._slots, self._cells, context.get_time())
        return EventStatus.Succeeded()
