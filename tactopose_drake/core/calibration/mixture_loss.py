"""A robust loss with an upper bound: what fits much worse than noise is taken for an outlier without influence.

It is twice the negative log likelihood of a mixture of a Gaussian and a uniform density: for squares r^2 far below the
limit it is r^2, far above it the limit.

Source: [OA13] E. Olson, P. Agarwal, Inference on networks of mixtures for robust robot mapping, 2013.
"""

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.validation import FloatArray

CONTACT_LIMIT = 16.3
"""For a contact's sum of squares: the 99.9 % quantile of chi-square with three degrees of freedom."""


def loss(square: FloatArray, limit: FloatArray | float) -> FloatArray:
    """The loss for sums of squares of whitened residuals, of any shape; zero at zero."""
    total: FloatArray = 2.0 * (np.logaddexp(0.0, -0.5 * np.asarray(limit)) - np.logaddexp(-0.5 * square, -0.5 * limit))
    return total


def weight(square: FloatArray, limit: FloatArray | float) -> FloatArray:
    """The derivative of the loss by the sum of squares: the probability of being an inlier."""
    share: FloatArray = 1.0 / (1.0 + np.exp(np.clip(0.5 * (square - limit), -700.0, 700.0)))
    return share


def grasp_limit(contacts: NDArray[np.int64]) -> FloatArray:
    """The limit of a grasp's loss for its number of contacts: five standard deviations above the expectation."""
    freedom = 3.0 * contacts
    limit: FloatArray = freedom + 5.0 * np.sqrt(2.0 * freedom)
    return limit
