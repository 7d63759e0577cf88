"""A force-torque sensor on a CAN bus or in a log, as a replacement for a simulated one."""

from typing import Any

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import Context, EventStatus, State

from tactopose_drake.core.validation import positive_number
from tactopose_drake.drivers.device import NO_SAMPLE, Device
from tactopose_drake.systems.collectable_system import CollectableSystem


class CanForceTorque(CollectableSystem):
    """Outputs the newest sample of a force-torque board, or of another sensor of wrenches, and its age.

    The sensor need not answer when the diagram starts, and may drop out and come back; the wrench is NaN meanwhile.
    Unlike the simulated sensor it does not know the fingertip's weight: the tare subtracts the load of that moment.

    .. pydrake_system::

        name: CanForceTorque
        output_ports:
        - wrench
        - age
        - status

    - wrench: F_S = [m_x, m_y, m_z, f_x, f_y, f_z] about the origin of the transducer's frame S, in S, N m and N.
      Changes once a period, first right after t = 0. NaN where there is no valid sample.
    - age: age of the newest sample, valid or not, s, shape (1,); infinite before the first. Changes with `wrench`.
    - status: str, the status of the sample (`ForceTorqueSample`), or why there is none: "no sample yet", "stale: " and
      its age, or what is wrong with the sensor or its bus. Changes with `wrench`.
    """

    def __init__(self, sensor: Device[Any], period: float = 0.005, max_age: float = 0.05) -> None:
        """Keeps the driver; the caller closes it.

        Args:
            sensor: the driver, of any device whose samples have `F_S`, as `ForceTorqueSample` has. On a bus without a
                thread, the diagram's time counts from the bus's origin.
            period: time between two polls, s.
            max_age: samples older than this are stale, s.
        """
        super().__init__()
        self._sensor = sensor
        self._max_age = positive_number("max_age", max_age)
        self._wrench = self.DeclareDiscreteState(np.full(6, np.nan))
        self._age = self.DeclareDiscreteState([np.inf])
        self._status = self.DeclareAbstractState(AbstractValue.Make(NO_SAMPLE))
        self.DeclarePeriodicUnrestrictedUpdateEvent(positive_number("period", period), 0.0, self._poll)
        self.DeclareStateOutputPort("wrench", self._wrench)
        self.DeclareStateOutputPort("age", self._age)
        self.DeclareStateOutputPort("status", self._status)

    def _poll(self, context: Context, state: State) -> EventStatus:
        now = self._sensor.bus.keep_up(context.get_time())
        sample, age, status = self._sensor.observe(self._max_age, now)
        wrench = np.full(6, np.nan) if sample is None else sample.F_S
        state.get_mutable_discrete_state(self._wrench).SetFromVector(wrench)
        state.get_mutable_discrete_state(self._age).SetFromVector([age])
        state.get_mutable_abstract_state(self._status).set_value(status)
        return EventStatus.Succeeded()
