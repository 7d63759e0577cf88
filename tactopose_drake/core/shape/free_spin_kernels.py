"""Rotations of poses about the axes of rotational symmetry of an object, compiled."""

import numpy as np

from tactopose_drake.core.compilation import kernel
from tactopose_drake.core.kernel_types import Floats2, Floats3, Longs1, OutFloats3
from tactopose_drake.core.kernels.pose_kernels import compose_one
from tactopose_drake.core.kernels.sorting_kernels import copy_matrix


@kernel
def take_nearest_image(reference: Floats2, turns: Floats3, X: Floats3, out: OutFloats3) -> None:
    """For each pose X (B, 3, 4), the image by one of the turns (g, 3, 4) whose rotation is nearest the reference's."""
    image = np.empty((3, 4))
    for b in range(X.shape[0]):
        most = -np.inf
        for s in range(turns.shape[0]):
            compose_one(X[b], turns[s], image)
            trace = 0.0
            for i in range(3):
                for k in range(3):
                    trace += image[i, k] * reference[i, k]
            if trace > most:
                most = trace
                copy_matrix(image, out[b])


@kernel
def turn_toward(reference: Floats3, choice: Longs1, axes: Floats2, points: Floats2, X: OutFloats3) -> None:
    """Rotates poses X (B, 3, 4) about each axis in turn so that their rotations are nearest to their references'.

    `choice` (B,) is the index of each pose's reference (n, 3, 4); axes (c, 3) are unit vectors in O, with points (c, 3)
    on them. trace(R_reference^T R exp(t a)) is a constant plus a cosine and a sine of t; it is largest at the nearest
    rotation.
    """
    for b in range(X.shape[0]):
        for c in range(axes.shape[0]):
            x, y, z = axes[c]
            u, v, w = points[c]
            cosine, sine = 0.0, 0.0
            for k in range(3):
                p, q, r = X[b, k, 0], X[b, k, 1], X[b, k, 2]
                e, f, g = reference[choice[b], k, 0], reference[choice[b], k, 1], reference[choice[b], k, 2]
                level, along = p * x + q * y + r * z, e * x + f * y + g * z
                cosine += e * p + f * q + g * r - level * along
                sine += e * (q * z - r * y) + f * (r * x - p * z) + g * (p * y - q * x)
            length = np.sqrt(cosine * cosine + sine * sine)
            if length == 0.0:
                continue  # All rotations are equally near.
            cosine, sine = cosine / length, sine / length
            for k in range(3):
                p, q, r = X[b, k, 0], X[b, k, 1], X[b, k, 2]
                level = (1.0 - cosine) * (p * x + q * y + r * z)
                X[b, k, 0] = cosine * p + level * x + sine * (q * z - r * y)
                X[b, k, 1] = cosine * q + level * y + sine * (r * x - p * z)
                X[b, k, 2] = cosine * r + level * z + sine * (p * y - q * x)
                X[b, k, 3] += (p - X[b, k, 0]) * u + (q - X[b, k, 1]) * v + (r - X[b, k, 2]) * w
