"""From the minima of a search to hypotheses: modes, probabilities, covariances, and the bound on them."""
