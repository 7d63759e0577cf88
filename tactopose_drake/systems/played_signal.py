"""Recorded signals as systems: they output the signal's value at the diagram's time."""

import numpy as np
from pydrake.math import RigidTransform
from pydrake.systems.framework import Context

from tactopose_drake.core.validation import FloatArray, instance_of
from tactopose_drake.systems.collectable_system import CollectableSystem
from tactopose_drake.systems.signals import UNKNOWN_POSE, Signal, Value


class PlayedVector(CollectableSystem):
    """Plays a recorded vector.

    .. pydrake_system::

        name: PlayedVector
        output_ports:
        - value

    - value: value of the signal at the current time, NaN before its first; a function of time.
    """

    def __init__(self, signal: Signal) -> None:
        """Keeps the signal.

        Raises:
            InvalidInputError: if its values are not vectors of one length.
        """
        super().__init__()
        instance_of("signal", signal, Signal)
        self._signal = signal
        self._before = np.full(signal.size, np.nan)
        self.declare_output("value", signal.size, self._value, {self.time_ticket()})

    def _value(self, context: Context) -> FloatArray:
        value: FloatArray | None = self._signal.at(context.get_time())
        return self._before if value is None else value


class PlayedValue(CollectableSystem):
    """Plays a recorded signal of any other kind, such as a `PosePrior` or a `RigidTransform`.

    .. pydrake_system::

        name: PlayedValue
        output_ports:
        - value

    - value: value of the signal at the current time, None before its first; a function of time. Since ports of a
      `RigidTransform` accept no None, a signal of them has NaN in its place, and before the first time its first value.
    """

    def __init__(self, signal: Signal) -> None:
        """Keeps the signal."""
        super().__init__()
        instance_of("signal", signal, Signal)
        self._signal, self._before = signal, None
        if any(isinstance(value, RigidTransform) for value in signal.values):
            self._signal = Signal(signal.times, [UNKNOWN_POSE if value is None else value for value in signal.values])
            self._before = self._signal.values[0]
        self.declare_output("value", self._before, self._value, {self.time_ticket()})

    def _value(self, context: Context) -> Value:
        value = self._signal.at(context.get_time())
        return self._before if value is None else value
