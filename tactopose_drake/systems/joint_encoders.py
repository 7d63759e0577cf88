"""The joint encoders of a simulated hand, with their errors."""

import numpy as np
from pydrake.common import RandomDistribution
from pydrake.systems.framework import Context

from tactopose_drake.core.validation import FloatArray, limited, positive_number
from tactopose_drake.systems.collectable_system import CollectableSystem

_FARTHEST = 10.0  # rad or m


class JointEncoders(CollectableSystem):
    """Measures a hand's joint positions with the encoders' offsets, noise and quantisation.

    .. pydrake_system::

        name: JointEncoders
        input_ports:
        - joint_positions
        - noise
        output_ports:
        - measured

    - joint_positions: true positions of the hand's joints, shape (nq,), rad.
    - noise: random input, a standard normal number for each encoder (`AddRandomInputs` connects it); the port exists
      only with `sigma` above 0.
    - measured: the measured positions, shape (nq,), rad; changes with both inputs. A joint coupled to another's encoder
      shares that encoder's error, but is rounded by itself. If the coupling's offset is not a multiple of the
      follower's step, the result differs by up to half a step from that of a hand which computes the follower's
      position from its leader's reading.
    """

    def __init__(self, gains: FloatArray, offsets: FloatArray, sigma: float = 0.0, step: float = 0.0) -> None:
        """Declares the ports.

        Args:
            gains: derivative of the positions by each encoder's error, shape (nq, k).
            offsets: what each encoder reads too much, shape (k,), rad.
            sigma: standard deviation of each encoder's reading, rad.
            step: quantisation step of the encoders, rad; 0 for none.
        """
        super().__init__()
        self._gains = gains
        self._offsets = gains @ limited("offsets", offsets, (gains.shape[1],), most=_FARTHEST)
        self._sigma = positive_number("sigma", sigma, allow_zero=True)
        # The step of a coupled joint is that of its leader, times their ratio.
        self._steps = np.abs(gains).max(axis=1, initial=0.0) * positive_number("step", step, allow_zero=True)
        self._positions = self.DeclareVectorInputPort("joint_positions", len(gains))
        self._noise = None
        tickets = {self._positions.ticket()}
        if self._sigma > 0.0:
            self._noise = self.DeclareVectorInputPort("noise", gains.shape[1], RandomDistribution.kGaussian)
            tickets |= {self._noise.ticket()}
        self.declare_output("measured", len(gains), self._measure, tickets)

    def _measure(self, context: Context) -> FloatArray:
        q = self._positions.Eval(context) + self._offsets
        if self._noise is not None:
            q = q + self._gains @ (self._sigma * self._noise.Eval(context))
        is_stepped = self._steps > 0.0
        steps = np.where(is_stepped, self._steps, 1.0)
        return np.where(is_stepped, steps * np.round(q / steps), q)
