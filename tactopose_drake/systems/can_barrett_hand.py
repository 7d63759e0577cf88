"""Barrett's BH8-280 hand on a CAN bus or in a log, as a replacement for simulated tactile arrays and joints."""

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import Context, EventStatus, State

from tactopose_drake.core.validation import positive_number
from tactopose_drake.drivers.barrett_hand import BarrettHand
from tactopose_drake.drivers.barrett_joints import JOINTS
from tactopose_drake.drivers.barrett_tactile import CELLS
from tactopose_drake.drivers.device import NO_SAMPLE
from tactopose_drake.systems.collectable_system import CollectableSystem

PADS = ("finger_1", "finger_2", "finger_3", "palm")  # in the order of the driver's arrays


class CanBarrettHand(CollectableSystem):
    """Outputs the newest sample of the hand and its age. It never moves the hand.

    The hand need not answer when the diagram starts; the whole hand or single fingers may drop out and come back. The
    outputs of what does not answer are NaN meanwhile.

    .. pydrake_system::

        name: CanBarrettHand
        output_ports:
        - joint_positions
        - pressures_finger_1
        - pressures_finger_2
        - pressures_finger_3
        - pressures_palm
        - fingertip_torques
        - age
        - status

    - joint_positions: in the order of `barrett_joints.JOINTS`, shape (7,), rad. NaN where there is no valid number.
      This and all other ports change once a period, first right after t = 0.
    - pressures_<pad>: of the pad's 24 cells, Pa; NaN as above.
    - fingertip_torques: about the outer joints of the fingers, shape (3,), N m; NaN as above.
    - age: age of the newest sample, s, shape (1,); infinite before the first.
    - status: str, the status of the sample (`HandSample`), or why there is none: "no sample yet", "stale: " and its
      age, or what is wrong with the hand or its bus.
    """

    def __init__(self, hand: BarrettHand, period: float = 0.025, max_age: float = 0.15) -> None:
        """Keeps the driver; the caller closes it.

        Args:
            hand: the driver. On a bus without a thread, the diagram's time counts from the bus's origin.
            period: time between two polls, s.
            max_age: samples older than this are stale, s.
        """
        super().__init__()
        self._hand = hand
        self._max_age = positive_number("max_age", max_age)
        self._positions = self.DeclareDiscreteState(np.full(len(JOINTS), np.nan))
        self._pressures = [self.DeclareDiscreteState(np.full(CELLS, np.nan)) for _ in PADS]
        self._torques = self.DeclareDiscreteState(np.full(3, np.nan))
        self._age = self.DeclareDiscreteState([np.inf])
        self._status = self.DeclareAbstractState(AbstractValue.Make(NO_SAMPLE))
        self.DeclarePeriodicUnrestrictedUpdateEvent(positive_number("period", period), 0.0, self._poll)
        self.DeclareStateOutputPort("joint_positions", self._positions)
        for pad, pressures in zip(PADS, self._pressures, strict=True):
            self.DeclareStateOutputPort(f"pressures_{pad}", pressures)
        self.DeclareStateOutputPort("fingertip_torques", self._torques)
        self.DeclareStateOutputPort("age", self._age)
        self.DeclareStateOutputPort("status", self._status)

    def _poll(self, context: Context, state: State) -> EventStatus:
        now = self._hand.bus.keep_up(context.get_time())
        sample, age, status = self._hand.observe(self._max_age, now)
        values = {
            self._positions: np.full(len(JOINTS), np.nan) if sample is None else sample.joint_positions,
            self._torques: np.full(3, np.nan) if sample is None else sample.fingertip_torques,
            self._age: np.array([age]),
        }
        for row, index in enumerate(self._pressures):
            values[index] = np.full(CELLS, np.nan) if sample is None else sample.pressures[row]
        for index, value in values.items():
            state.get_mutable_discrete_state(index).SetFromVector(value)
        state.get_mutable_abstract_state(self._status).set_value(status)
        return EventStatus.Succeeded()
