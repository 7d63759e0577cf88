"""Modes that overlap are one: a valley with bumps along its floor has many minima, and is one hypothesis.

Two equal Gaussians of a mixture make one peak when their means are within two standard deviations of each other; modes
are one up to three, for samples leave it open whether those along a valley are closer. That is asked of the modes as
they were sampled: often they are much wider than the curvature at their minima says.
"""

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.posterior.joining_kernels import Joined, join
from tactopose_drake.core.posterior.mode_moments import Moments
from tactopose_drake.core.posterior.posterior_params import DEFAULT_PARAMS, MomentParams
from tactopose_drake.core.validation import FloatArray


def join_overlapping(
    X_PO: FloatArray,
    cost: FloatArray,
    mass: FloatArray,
    spread: FloatArray,
    moments: Moments,
    symmetry_poses: FloatArray,
    params: MomentParams = DEFAULT_PARAMS.moments,
) -> tuple[FloatArray, Moments, NDArray[np.intp]]:
    """The masses and moments of modes of which those that overlap, up to a symmetry, are one: that of the lowest cost.

    Args:
        X_PO: minima, shape (g, 3, 4).
        cost: of the minima, shape (g,).
        mass: of the modes, shape (g,).
        spread: their covariances about the minima, shape (g, 6, 6).
        moments: of increments from the minima.
        symmetry_poses: the object's finite symmetry group as poses X_OO', the identity first, shape (s, 3, 4).
        params: which modes overlap.

    Returns:
        Masses, none for a mode that another one has taken in; the moments; and which mode each one is part of.
    """
    mass, joint = mass.copy(), Moments(*(moment.copy() for moment in moments))
    spread = spread - moments.first[:, :, None] * moments.first[:, None]
    limits = params.peak_sigmas, params.widest_turn
    order, owner = np.argsort(cost, kind="stable"), np.empty(len(X_PO), dtype=np.intp)
    join(X_PO, order, symmetry_poses, limits, Joined(mass, spread, *joint), owner)
    return mass, joint, owner
