"""The conversion of a hand's measured joints to the positions of its plant, as a system."""

import numpy as np
from pydrake.systems.framework import Context

from tactopose_drake.core.validation import FloatArray, finite_array
from tactopose_drake.systems.collectable_system import CollectableSystem


class MeasuredJoints(CollectableSystem):
    """Puts measured joints into the plant's order, and computes the coupled joints from them.

    Unlike with a `MatrixGain`, an unknown joint (NaN) does not spread to unrelated joints.

    .. pydrake_system::

        name: MeasuredJoints
        input_ports:
        - measured
        output_ports:
        - joint_positions

    - measured: in the hand's own order, shape (k,), rad; NaN where a joint is unknown.
    - joint_positions: of the plant, shape (nq,), rad; NaN where the measured joint that it follows is unknown.
    """

    def __init__(self, matrix: FloatArray, offsets: FloatArray | float = 0.0) -> None:
        """Takes the order and the ratios from a matrix.

        Args:
            matrix: `joint_matrix` of the hand, shape (nq, k), with one nonzero entry in each row.
            offsets: `joint_offsets` of the hand, shape (nq,), rad, which are added.
        """
        super().__init__()
        matrix = finite_array("matrix", matrix, (None, None))
        self._column = np.argmax(matrix != 0.0, axis=1)
        self._ratio = matrix[np.arange(len(matrix)), self._column]
        self._offsets = offsets
        self._measured = self.DeclareVectorInputPort("measured", matrix.shape[1])
        self.declare_output("joint_positions", len(matrix), self._joint_positions, {self._measured.ticket()})

    def _joint_positions(self, context: Context) -> FloatArray:
        q: FloatArray = self._ratio * self._measured.Eval(context)[self._column] + self._offsets
        return q
