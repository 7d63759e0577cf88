"""The conversion of an external tracker's pose to a `PoseMeasurement`, as a system."""

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.systems.framework import Context

from tactopose_drake.core.tracking.frame import PoseMeasurement
from tactopose_drake.errors import InvalidInputError
from tactopose_drake.systems.collectable_system import CollectableSystem, declare_cache
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
        self._measured = declare_cache(
            self,
            "measurement and status",
            lambda: AbstractValue.Make((None, "")),
            self._measure,
            {port.ticket() for port in (self._pose, self._time, self._covariance)},
        )
        for index, (name, model) in enumerate((("vision", None), ("status", ""))):
            self._declare_output(name, AbstractValue.Make(model), index)

    def _declare_output(self, name: str, model: AbstractValue, index: int) -> None:
        def calc(context: Context, output: AbstractValue) -> None:
            output.set_value(self._measured.Eval(context)[index])

        self.DeclareAbstractOutputPort(name, model.Clone, calc, prerequisites_of_calc={self._measured.ticket()})

    def _measure(self, context: Context, cached: AbstractValue) -> None:
        pose = eval_input(self._pose, context, RigidTransform)
        covariance = np.asarray(self._covariance.Eval(context)).reshape(6, 6)
        try:
            measured = PoseMeasurement(self._time.Eval(context)[0], pose.GetAsMatrix34(), covariance), "ok"
        except InvalidInputError as error:
            cached.set_value((None, str(error)))
            return
        cached.set_value(measured)
