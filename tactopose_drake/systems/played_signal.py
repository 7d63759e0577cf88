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
        self._signal = signal  # Not a copy: whoever made it may add changes.
        is_pose = any(isinstance(value, RigidTransform) for value in signal.values)
        self._unknown = UNKNOWN_POSE if is_pose else None
        self._before = self._known(signal.values[0]) if is_pose else None
        self.declare_output("value", self._before, self._value, {self.time_ticket()})

    def _known(self, value: Value) -> Value:
        return self._unknown if value is None else value

    def _value(self, context: Context) -> Value:
        time = context.get_time()
        return self._before if time < self._signal.times[0] else self._known(self._signal.at(time))
