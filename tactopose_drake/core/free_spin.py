"""One representative of all the poses that differ by a turn about an object's continuous axis of symmetry."""

from collections.abc import Sequence

import numpy as np

from tactopose_drake.core.poses import compose, exp_so3, make_poses, skew
from tactopose_drake.core.symmetry import RotationalSymmetry
from tactopose_drake.core.validation import FloatArray

# One axis needs one turn; a sphere's three are turned in rounds, each of which brings the pose nearer.
_ROUNDS = 6


def turn_toward(X_PO: FloatArray, X_reference: FloatArray, symmetries: Sequence[RotationalSymmetry]) -> FloatArray:
    """The poses (B, 3, 4), turned about the continuous axes until their rotations are nearest to the reference's.

    The object does not change by the turns. Of a turn exp(t a) the trace of R_reference^T R exp(t a) is a constant plus
    a cosine and a sine of t, whose largest value is where the rotation is nearest.
    """
    axes = [symmetry for symmetry in symmetries if symmetry.is_continuous]
    for symmetry in axes * (_ROUNDS if len(axes) > 1 else 1):
        M = X_reference[:, :3].T @ X_PO[:, :, :3]
        a = symmetry.axis
        cosine = np.trace(M, axis1=1, axis2=2) - np.einsum("i,bij,j->b", a, M, a)
        sine = np.einsum("bij,ji->b", M, skew(a))
        R = exp_so3(np.arctan2(sine, cosine)[:, None] * a)
        X_PO = compose(X_PO, make_poses(R, symmetry.point - R @ symmetry.point))
    return X_PO
