"""The encoders of a simulated hand's joints, which show other angles than there are."""

import numpy as np
from pydrake.common import RandomDistribution
from pydrake.systems.framework import BasicVector, Context

from tactopose_drake.core.validation import FloatArray, limited, positive_number
from tactopose_drake.systems.collectable_system import CollectableSystem

_FARTHEST = 10.0  # rad or m


class JointEncoders(CollectableSystem):
    """Shows a hand's joint positions with the encoders' offsets, noise and quantisation.

    .. pydrake_system::

        name: JointEncoders
        input_ports:
        - joint_positions
        - noise
        output_ports:
        - measured

    - joint_positions: true positions of the hand's joints, shape (nq,), rad.
    - noise: random input, a standard normal number for each encoder (`AddRandomInputs` connects it); there is such a
      port only where there is noise.
    - measured: what is known of the positions, shape (nq,), rad; changes with both inputs. Joints that follow another's
      encoder err with it, but each is rounded by itself: where a coupling has an offset that is no whole number of the
      follower's steps, the two are up to half such a step from where a hand has them that computes the follower's
      position from its leader's reading.
    """

    def __init__(self, gains: FloatArray, offsets: FloatArray, sigma: float = 0.0, step: float = 0.0) -> None:
        """Declares the ports.

        Args:
            gains: what an error of one in each encoder adds to the positions, shape (nq, k).
            offsets: what each encoder shows too much, shape (k,).
            sigma: standard deviation of each reading.
            step: quantisation of what each joint shows, in the encoders' unit; 0 for none.
        """
        super().__init__()
        self._gains = gains
        self._offsets = gains @ limited("offsets", offsets, (gains.shape[1],), most=_FARTHEST)
        self._sigma = positive_number("sigma", sigma, allow_zero=True)
        # Of a joint that follows, the step is that of its leader, times their ratio.
        self._steps = np.abs(gains).max(axis=1, initial=0.0) * positive_number("step", step, allow_zero=True)
        self._positions = self.DeclareVectorInputPort("joint_positions", len(gains))
        self._noise = None
        tickets = {self._positions.ticket()}
        if self._sigma > 0.0:
            self._noise = self.DeclareVectorInputPort("noise", gains.shape[1], RandomDistribution.kGaussian)
            tickets |= {self._noise.ticket()}
        self.DeclareVectorOutputPort("measured", len(gains), self._calc, prerequisites_of_calc=tickets)

    def _calc(self, context: Context, output: BasicVector) -> None:
        q = self._positions.Eval(context) + self._offsets
        if self._noise is not None:
            q = q + self._gains @ (self._sigma * self._noise.Eval(context))
        is_stepped = self._steps > 0.0
        steps = np.where(is_stepped, self._steps, 1.0)
        output.SetFromVector(np.where(is_stepped, steps * np.round(q / steps), q))
