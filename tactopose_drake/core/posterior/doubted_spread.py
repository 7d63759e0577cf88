"""How far off a mode may be if one of the contacts is false.

A contact that alone tells a direction is believed, and yet one of a few is displaced by a centimetre or two. That is a
rare event of large effect: the few samples of a mode hold one or none of it, and their covariance says too little. What
a contact's distance tells is one row J of the Jacobian. With H the Hessian of all and H_i that without it, poses along
the line d = H^-1 J are those that go where the contact does not hold them, the others followed as well as they can be,
and what is across the line spreads as before. So the exact posterior along that line, as far as H_i lets it go, is its
density by how far the contact is wrong, and no covariance is said to be less along it. It is likewise with a contact
that may have any normal, along the direction that loses most.
"""

import numpy as np

from tactopose_drake.core.plain_values import copied
from tactopose_drake.core.posterior.doubted_spread_kernels import Lines, lay_lines, widen_modes
from tactopose_drake.core.posterior.hypotheses import Modes
from tactopose_drake.core.posterior.posterior import Posterior


def widen_by_doubt(modes: Modes, posterior: Posterior) -> Modes:
    """The modes, each no narrower than doubt of single contacts makes it; those of little weight stay as they are."""
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
