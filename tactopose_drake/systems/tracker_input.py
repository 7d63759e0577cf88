"""The conversion of an external tracker's pose to a `PoseMeasurement`, as a system."""

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.systems.framework import Context

from tactopose_drake.core.tracking.frame import PoseMeasurement
from tactopose_drake.errors import InvalidInputError
from tactopose_drake.systems.collectable_system import CollectableSystem
from tactopose_drake.systems.ports import eval_input


class TrackerInput(CollectableSystem):
    """Converts a tracker's pose to a measurement; an invalid one counts as no answer, and the status says why.

    .. pydrake_system::

        name: TrackerInput
        input_ports:
        - pose
        - picture_time
        - covariance
        output_ports:
        - vision
        - status

    - pose: `RigidTransform` X_PO at the time of the picture.
    - picture_time: time of the picture, not of its delivery, by the diagram's clock, s, shape (1,).
    - covariance: covariance of the increment (w, v) from the pose to the true one, row by row, shape (36,), rad and m.
    - vision: `PoseMeasurement`, or None if a number is not finite or the covariance is invalid; changes
      with any input.
    - status: str, "ok", or why there is no measurement; changes with any input.
    """

    def __init__(self) -> None:
        """Declares the ports."""
        super().__init__()
        self._pose = self.DeclareAbstractInputPort("pose", AbstractValue.Make(RigidTransform()))
        self._time = self.DeclareVectorInputPort("picture_time", 1)
        self._covariance = self.DeclareVectorInputPort("covariance", 36)
        needs = {port.ticket() for port in (self._pose, self._time, self._covariance)}
        self._measured = self.declare_value("measurement and status", self._measure, needs)
        measured = {self._measured.ticket()}
        self.declare_output("vision", None, lambda context: self._measured.Eval(context)[0], measured)
        self.declare_output("status", "", lambda context: self._measured.Eval(context)[1], measured)

    def _measure(self, context: Context) -> tuple[PoseMeasurement | None, str]:
        pose = eval_input(self._pose, context, RigidTransform)
        covariance = np.asarray(self._covariance.Eval(context)).reshape(6, 6)
        try:
            return PoseMeasurement(self._time.Eval(context)[0], pose.GetAsMatrix34(), covariance), "ok"
        except InvalidInputError as error:
            return None, str(error)
