"""A fast collision check between object and hand for many poses.

Source: [B16] J. Bimbo, thesis, 2016, section 4.2.7 and figure 4.6.
"""

import numpy as np
import scipy
from numpy.typing import NDArray

from tactopose_drake.core.evidence.hand_geometry import HandGeometry
from tactopose_drake.core.validation import FloatArray

# Share of a sphere's radius that the object's points keep from its centre: fingertips touch the object, with noise.
_VICINITY = 0.5


class HandClearance:
    """Tests whether no point of the object lies in the vicinity of the points inside the hand.

    The points inside the hand are the centres of its spheres; the vicinity of each is half of its radius.
    """

    def __init__(self, points: FloatArray, hand: HandGeometry) -> None:
        """Takes the object's point cloud in O (n, 3), m, and the hand."""
        self._tree, self._hand = scipy.spatial.cKDTree(points), hand

    def __call__(self, X_PO: FloatArray) -> NDArray[np.bool_]:
        """Whether the hand is clear of the object at each of the poses (B, 3, 4), shape (B,)."""
        q = (self._hand.p_PH - X_PO[:, None, :, 3]) @ X_PO[:, :, :3]
        distance, _ = self._tree.query(q)
        clear: NDArray[np.bool_] = np.all(distance >= _VICINITY * self._hand.radius, axis=1)
        return clear
