"""A Meshcat display of the likelihoods of the objects that a hand may hold, as a system."""

import dataclasses
from collections.abc import Sequence

from pydrake.common.value import AbstractValue
from pydrake.geometry import Meshcat
from pydrake.systems.framework import Context, EventStatus

from tactopose_drake.core.parameter_checks import params_of
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import check_count, positive_number
from tactopose_drake.estimation.identities import Identification
from tactopose_drake.systems.collectable_system import CollectableSystem
from tactopose_drake.systems.ports import eval_optional_input
from tactopose_drake.visualization.likelihood_bars import add_bars, look_at_bars, set_bars
from tactopose_drake.visualization.meshcat import check_meshcat


@dataclasses.dataclass(kw_only=True, slots=True)
class LikelihoodDisplayParams:
    """Where likelihoods are displayed, and how often."""

    period: float = 1.0 / 8.0  # s between two frames
    path: str = "/tactopose_identity"  # of all parts in Meshcat's tree
    aim_camera: bool = False  # whether to aim the camera at the bars once, when a simulation is initialized

    def validate(self) -> None:
        """Raises InvalidInputError if the period is not positive."""
        positive_number("LikelihoodDisplayParams.period", self.period)


class LikelihoodDisplay(CollectableSystem):
    """Shows the likelihoods of several objects as bars beside their shapes.

    .. pydrake_system::

        name: LikelihoodDisplay
        input_ports:
        - identities

    - identities: `Identification`, or None while there is none; read once a period, and at a `ForcedPublish`. Objects
      are matched by name.

    The display is part of Meshcat's recording when one is running.
    """

    def __init__(
        self,
        meshcat: Meshcat,
        models: Sequence[ObjectModel],
        params: LikelihoodDisplayParams | None = None,
    ) -> None:
        """Keeps a reference to the display; the bars are created when a simulation is initialized.

        Args:
            meshcat: the display.
            models: the objects, one row each from the top; y runs along the bars, z up.
            params: path and period.

        Raises:
            InvalidInputError: if there is no display or no object.
        """
        super().__init__()
        check_meshcat(meshcat)
        self._params = params_of(LikelihoodDisplayParams, params)
        check_count("models", len(models), "objects")
        self._meshcat, self._models = meshcat, tuple(models)
        self._identities = self.DeclareAbstractInputPort("identities", AbstractValue.Make(None))
        self.DeclareInitializationPublishEvent(self._make_rows)
        self.DeclarePeriodicPublishEvent(self._params.period, 0.0, self._stretch_bars)
        self.DeclareForcedPublishEvent(self._stretch_bars)

    def _make_rows(self, context: Context) -> EventStatus:
        add_bars(self._meshcat, self._params.path, self._models)
        if self._params.aim_camera:
            look_at_bars(self._meshcat, len(self._models))
        return EventStatus.Succeeded()

    def _stretch_bars(self, context: Context) -> EventStatus:
        # No simulation was initialized, or somebody has deleted the parts.
        if not self._meshcat.HasPath(self._params.path):
            self._make_rows(context)
        found = eval_optional_input(self._identities, context, Identification)
        set_bars(self._meshcat, self._params.path, self._models, found, context.get_time())
        return EventStatus.Succeeded()
