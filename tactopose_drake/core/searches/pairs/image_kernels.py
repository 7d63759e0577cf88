"""Tests whether poses are near a centre, up to the object's symmetries."""

from typing import NamedTuple

import numpy as np

from tactopose_drake.core.compilation import inlined
from tactopose_drake.core.kernel_types import Floats1, Floats2, Floats3


class Images(NamedTuple):
    """The neighbourhood of a centre, up to g symmetries; read-only.

    Attributes:
        rotations: rotations to compare a pose's rotation with, one for each symmetry, shape (g, 3, 3).
        origins: the images' origins in O, shape (g, 3), m.
        center: of the poses' origins, shape (3,), m.
        least_trace: least trace of the relative rotation that is near enough.
        farthest: squared largest distance, m^2; infinite if all poses are near enough.
    """

    rotations: Floats3
    origins: Floats2
    center: Floats1
    least_trace: float
    farthest: float


@inlined
def is_near(X, images):
    """Whether an image of the pose X, by one of g symmetries, is near enough to the centre."""
    rotations, origins, center = images.rotations, images.origins, images.center
    for s in range(rotations.shape[0]):
        distance, trace = 0.0, 0.0
        for a in range(3):
            way = X[a, 3] - center[a]
            for b in range(3):
                way += X[a, b] * origins[s, b]
                trace += X[a, b] * rotations[s, a, b]
            distance += way * way
        if distance <= images.farthest and trace >= images.least_trace:
            return True
    return False


@inlined
def may_be_near(points, i, j, frame, images):
    """Whether poses that align the frame's x with the line between two samples may be near; a necessary condition."""
    x, y, z = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1], points[j, 2] - points[i, 2]
    rotations, length = images.rotations, np.sqrt(x * x + y * y + z * z)
    least = (0.5 * (images.least_trace - 1.0) - 1e-9) * length
    for s in range(rotations.shape[0]):
        along = 0.0
        for a in range(3):
            along += frame[1, a] * (rotations[s, a, 0] * x + rotations[s, a, 1] * y + rotations[s, a, 2] * z)
        if along >= least:
            return True
    return False
