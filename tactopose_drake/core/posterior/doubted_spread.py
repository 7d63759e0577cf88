"""Widens modes for the possibility that one of the contacts is an outlier.

Where a single contact determines a direction, it is trusted, although one contact in a few may be off by a centimetre
or two. This is a rare event of large effect: the few samples of a mode hold one or none of it, and their covariance is
too small. A contact's distance adds one row J to the Jacobian. With H the Hessian of all residuals and H_i that without
this one, moving along d = H^-1 J^T changes this residual and the others as little as possible, and the spread in the
H-conjugate directions stays as it was. So the exact posterior is evaluated along this line, as far as H_i allows, and
no covariance is left smaller along it. The same is done for a contact whose normal may be arbitrary, along the
direction that loses most information.
"""

import numpy as np

from tactopose_drake.core.plain_values import copied
from tactopose_drake.core.posterior.doubted_spread_kernels import Lines, lay_lines, widen_modes
from tactopose_drake.core.posterior.modes import Modes
from tactopose_drake.core.posterior.posterior import Posterior


def widen_by_doubt(modes: Modes, posterior: Posterior) -> Modes:
    """Widens each mode along the lines where one contact may be false; modes of low weight are returned unchanged."""
    mixture = modes.mixture
    likely = (mixture.weights > posterior.params.sampling.least_tailed_share).nonzero()[0]
    if posterior.alternatives is None or not len(likely):
        return modes
    X_PO, covariance = mixture.X_PO[likely], mixture.covariance.copy()
    information = posterior.likelihood.normal_equations(X_PO).hessian + posterior.prior_information + posterior.gauge
    left = posterior.alternatives(X_PO, information)
    lines = Lines.empty(left.shape[0] * left.shape[1])
    lines = lines.first(lay_lines(X_PO, information, left, lines))
    cost = posterior.exact_cost(np.concatenate([X_PO, lines.X.reshape(-1, 3, 4)]))
    widened = covariance[likely]
    widen_modes(lines, cost[: len(X_PO)], cost[len(X_PO) :].reshape(lines.place.shape), information, widened)
    covariance[likely] = widened
    return copied(modes, mixture=copied(mixture, covariance=covariance))
