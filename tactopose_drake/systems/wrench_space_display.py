"""A Meshcat display of the wrenches that a grasp can exert, as a system."""

import dataclasses

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.geometry import Meshcat
from pydrake.math import RigidTransform
from pydrake.systems.framework import Context, EventStatus

from tactopose_drake.core.grasping.quality import GraspQuality
from tactopose_drake.core.parameter_checks import params_of
from tactopose_drake.core.validation import finite_array, positive_number
from tactopose_drake.systems.collectable_system import CollectableSystem
from tactopose_drake.systems.ports import eval_optional_input
from tactopose_drake.visualization.meshcat import check_meshcat, look_at
from tactopose_drake.visualization.wrench_spaces import draw_wrench_space

_SEEN = 10.0  # width of the camera's view, N
_FROM = np.array([0.6, 0.3, 0.2])  # direction to the camera


@dataclasses.dataclass(kw_only=True, slots=True)
class WrenchSpaceDisplayParams:
    """Where and how large wrench spaces are displayed, and how often."""

    period: float = 0.25  # s between two drawings
    path: str = "/tactopose_wrenches"  # of all parts in Meshcat's tree
    scale: float = 0.1  # length of 1 N, m
    place: list[float] = dataclasses.field(default_factory=lambda: [0.0, 0.0, 0.3])  # of the origin in the world, m
    aim_camera: bool = False  # whether to aim the camera at `place` once, when a simulation is initialized

    def validate(self) -> None:
        """Raises InvalidInputError if a value is out of its range."""
        positive_number("WrenchSpaceDisplayParams.period", self.period)
        positive_number("WrenchSpaceDisplayParams.scale", self.scale)
        finite_array("WrenchSpaceDisplayParams.place", self.place, (3,))


class WrenchSpaceDisplay(CollectableSystem):
    """Shows the forces (green) and torques (red) that the contacts can exert, as two hulls beside the hand.

    .. pydrake_system::

        name: WrenchSpaceDisplay
        input_ports:
        - quality

    - quality: `GraspQuality`, or None while there is none; read once a period, and at a `ForcedPublish`. The axes are
      the object's. Meshcat cannot record the changes of the hulls' shapes: a recording holds the last ones.
    """

    def __init__(self, meshcat: Meshcat, params: WrenchSpaceDisplayParams | None = None) -> None:
        """Keeps a reference to the display.

        Raises:
            InvalidInputError: if there is no display, or a parameter is out of its range.
        """
        super().__init__()
        check_meshcat(meshcat)
        self._params = params_of(WrenchSpaceDisplayParams, params)
        self._meshcat = meshcat
        self._quality = self.DeclareAbstractInputPort("quality", AbstractValue.Make(None))
        self.DeclareInitializationPublishEvent(self._place)
        self.DeclarePeriodicPublishEvent(self._params.period, 0.0, self._draw)
        self.DeclareForcedPublishEvent(self._draw)

    def _place(self, context: Context) -> EventStatus:
        self._meshcat.Delete(self._params.path)
        self._meshcat.SetTransform(self._params.path, RigidTransform(self._params.place))
        if self._params.aim_camera:
            look_at(self._meshcat, np.array(self._params.place), _SEEN * self._params.scale, _FROM)
        return EventStatus.Succeeded()

    def _draw(self, context: Context) -> EventStatus:
        # No simulation was initialized, or somebody has deleted the parts.
        if not self._meshcat.HasPath(self._params.path):
            self._place(context)
        quality = eval_optional_input(self._quality, context, GraspQuality)
        if quality is not None:
            draw_wrench_space(self._meshcat, self._params.path, quality.space, scale=self._params.scale)
        return EventStatus.Succeeded()
