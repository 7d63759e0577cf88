"""From the minima of a search to hypotheses: modes, probabilities, covariances, and the bound on them."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
