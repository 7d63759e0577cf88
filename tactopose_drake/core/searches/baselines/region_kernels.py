"""Thins samples of overlapping regions, compiled."""

import numpy as np

from tactopose_drake.core.compilation import kernel
from tactopose_drake.core.kernel_types import Floats1, Floats3, OutFlags1


@kernel
def mark_first(X_region: Floats3, samples: Floats3, per_region: int, radii: Floats1, first: OutFlags1) -> None:
    """Marks the samples of each region that no earlier region contains, so that the cover stays even."""
    trace, way = 1.0 + 2.0 * np.cos(min(radii[0], np.pi)), radii[1]
    for b in range(len(samples)):
        Y = samples[b]
        first[b] = True
        for a in range(b // per_region):
            X = X_region[a]
            square = 0.0
            for i in range(3):
                square += (X[i, 3] - Y[i, 3]) ** 2
            if square >= way * way:
                continue
            dot = 0.0
            for i in range(3):
                for j in range(3):
                    dot += X[i, j] * Y[i, j]
            if dot > trace:
                first[b] = False
                break
