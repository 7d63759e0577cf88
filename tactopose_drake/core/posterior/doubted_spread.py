"""How far off a mode may be if one of the contacts is false.

A contact that alone tells a direction is believed, and yet one of a few is displaced by a centimetre or two. That is a
rare event of large effect: the few samples of a mode hold one or none of it, and their covariance says too little. So
each mode is taken for a mixture of Gaussians, too: one if all contacts are as told, and one each if one is displaced or
has any normal, by the local model of the cost that is left then. With gradient g and Hessian H of one, and its share w
at the mode, it lies at u = -H^-1 g with weight w exp(g^T H^-1 g / 2) / sqrt(det H) and covariance H^-1. The mixture's
mean product of increments is the least that a mode's covariance is said to be, in each direction.
"""

from tactopose_drake.core.plain_values import copied
from tactopose_drake.core.posterior.doubted_spread_kernels import widen_modes
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
    gradient = posterior.objective.normal_equations(X_PO).gradient
    widened = covariance[likely]
    widen_modes(posterior.alternatives(X_PO, gradient, information), widened)
    covariance[likely] = widened
    return copied(modes, mixture=copied(mixture, covariance=covariance))
