"""What is believed of the object's pose, as a message for LCM."""

import time

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import Context

from tactopose_drake.core.validation import whole_number
from tactopose_drake.drivers.lcm_messages import HandSensesMessage, ObjectBeliefMessage
from tactopose_drake.estimation.results import PoseEstimate
from tactopose_drake.systems.collectable_system import CollectableSystem
from tactopose_drake.systems.ports import eval_input, eval_optional_input


class LcmBelief(CollectableSystem):
    """Makes messages `lcmt_object_belief` of an estimate or a belief, for an `LcmPublisherSystem`.

    .. pydrake_system::

        name: LcmBelief
        input_ports:
        - hypotheses
        - status
        - senses
        output_ports:
        - message

    - hypotheses: `PoseEstimate`, or None where there is none yet.
    - status: str.
    - senses: `HandSensesMessage`, the newest; may stay unconnected: `utime` is then the diagram's time.
    - message: `ObjectBeliefMessage`, with `utime` and `sequence` of the senses of now; changes with the inputs.
      A belief that is shown with a `latency`, or that a thread computes, is of senses as much earlier.
    """

    def __init__(self, max_modes: int = 8) -> None:
        """Declares the ports.

        Args:
            max_modes: that a message has, the most probable ones.

        Raises:
            InvalidInputError: if they are no integer above 0.
        """
        super().__init__()
        self._max_modes, self._session = whole_number("max_modes", max_modes, least=1), time.time_ns()
        self._hypotheses = self.DeclareAbstractInputPort("hypotheses", AbstractValue.Make(None))
        self._status = self.DeclareAbstractInputPort("status", AbstractValue.Make(""))
        self._senses = self.DeclareAbstractInputPort("senses", AbstractValue.Make(HandSensesMessage()))
        self.DeclareAbstractOutputPort("message", lambda: AbstractValue.Make(ObjectBeliefMessage()), self._calc)

    def _calc(self, context: Context, output: AbstractValue) -> None:
        message = belief_message(
            eval_optional_input(self._hypotheses, context, PoseEstimate),
            eval_input(self._status, context, str),
            self._max_modes,
        )
        message.session = self._session
        senses = eval_optional_input(self._senses, context, HandSensesMessage)
        message.utime = round(1e6 * context.get_time()) if senses is None else senses.utime
        message.sequence = -1 if senses is None else senses.sequence
        output.set_value(message)


def belief_message(estimate: PoseEstimate | None, status: str, max_modes: int) -> ObjectBeliefMessage:
    """A message of the most probable hypotheses, without times and counts.

    Args:
        estimate: None where there is none yet.
        status: in words.
        max_modes: that it has.
    """
    modes = () if estimate is None else estimate.hypotheses[:max_modes]
    if not modes:
        return ObjectBeliefMessage(status=status)
    return ObjectBeliefMessage(
        status=status,
        probability=np.array([mode.probability for mode in modes]),
        position=np.array([mode.X_PO.translation() for mode in modes]),
        quaternion_wxyz=np.array([mode.X_PO.rotation().ToQuaternion().wxyz() for mode in modes]),
        covariance=np.array([mode.covariance for mode in modes]),
    )
