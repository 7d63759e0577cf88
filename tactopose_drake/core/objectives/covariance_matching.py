"""Patches against the covariance of the object's points that lie in front of the pads: the thesis' objective.

Source: [B16] J. Bimbo, thesis, 2016, section 5.2.4, eq. 5.8, and algorithm 5.2.
"""

from collections.abc import Sequence

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from tactopose_drake.core.kernels.pose_kernels import to_object
from tactopose_drake.core.objectives.differenced import DifferencedObjective
from tactopose_drake.core.sensing.patches import Patch
from tactopose_drake.core.sensing.sensing_range import sensing_box
from tactopose_drake.core.shape.point_grid import PointGrid, nearest_square, slot_of
from tactopose_drake.core.validation import FloatArray, finite_array, positive_number


def covariance_mismatch(covariance: ArrayLike, eigenvalues: ArrayLike) -> float:
    """q, the Frobenius norm of the difference between a covariance in the eigenbasis (3, 3) and the eigenvalues (3,).

    [B16] eq. 5.8; in the unit of the two.
    """
    C = finite_array("covariance", covariance, (3, 3))
    return float(np.linalg.norm(C - np.diag(finite_array("eigenvalues", eigenvalues, (3,)))))


class CovarianceMatching(DifferencedObjective):
    """[B16] algorithm 5.2: for each pad that feels the object, how unlike the patch the points in front of it are.

    With s the points of the cloud in the pad's sensing box, d the distance from the patch's centroid to the cloud, and
    Λ the patch's covariance in its eigenbasis, a pad costs, in metres,

    - |mean s - centroid| + h3 |cov s - Λ| + h2 (sum of the depths of s below the finger's stiff core) where the box
      holds more than three points and d is within the gate;
    - h1 d + h3 |Λ| elsewhere.

    The norm is the same in every frame, so the covariances are compared in the pad's. Of two active cells or a row the
    covariance is compared as it is; of one cell there is none, and its term is left out; a pad that feels nothing
    costs nothing. The listing's slips are read so: line 9 stands before its loop; line 22 adds, as line 19 does; the
    mean of line 17 is its norm, as in the text. The residuals are the roots of twice the pads' costs.
    """

    def __init__(
        self,
        cloud: PointGrid,
        patches: Sequence[Patch],
        *,
        thickness: float = 0.002,
        height: float = 0.003,
        gate: float = 0.03,
        h1: float = 2.0,
        h2: float = 0.1,
        h3: float = 1000.0,
    ) -> None:
        """Lays a sensing box on each pad.

        Args:
            cloud: the object's points.
            patches: what the pads feel, in P.
            thickness: of the pads' soft layer, m.
            height: of the sensing box above the pad, m.
            gate: the largest distance at which patches are compared, m. [B16]: 30 mm.
            h1: weight of the distance where there is no patch to compare.
            h2: weight of each point's depth below the finger's core.
            h3: weight of the covariance, 1/m.

        Raises:
            InvalidInputError: a number out of range, or a pad of one cell.
        """
        felt = [patch for patch in patches if patch.status != "no_contact"]
        boxes = [sensing_box(patch, thickness=thickness, height=height) for patch in felt]
        rotations = np.array([box.X_PB[:, :3] for box in boxes]).reshape(-1, 3, 3)
        centroids = np.array([patch.centroid for patch in felt]).reshape(-1, 3)
        covariances = np.array([patch.covariance for patch in felt]).reshape(-1, 3, 3)
        weights = np.array(
            [
                positive_number("gate", gate),
                positive_number("h1", h1),
                positive_number("h2", h2, allow_zero=True),
                positive_number("h3", h3, allow_zero=True),
            ]
        )
        self._arguments = (
            *cloud.arguments,
            np.array([box.X_PB for box in boxes]).reshape(-1, 3, 4),
            np.array([box.lower for box in boxes]).reshape(-1, 3),
            np.array([box.upper for box in boxes]).reshape(-1, 3),
            centroids,
            np.swapaxes(rotations, 1, 2) @ covariances @ rotations,
            weights,
        )
        self._count = len(felt)

    def residuals(self, X_PO: FloatArray) -> FloatArray:
        """Residuals (B, k) of poses (B, 3, 4), with k pads that feel the object."""
        costs = np.empty((len(X_PO), self._count))
        _pad_costs(*self._arguments, X_PO, costs)
        return np.sqrt(2.0 * costs)


@njit(cache=True, inline="always")
def _place(X, X_PB, lower, upper, centroid, R, p, c, low, high):  # type: ignore[no-untyped-def]
    """A box seen from the object at the pose X: R = R_OB, p = p_OB, and the corners, along O's axes, of what holds it.

    c is the patch's centroid in B.
    """
    for a in range(3):
        p[a] = 0.0
        for e in range(3):
            p[a] += X[e, a] * (X_PB[e, 3] - X[e, 3])
            R[a, e] = X[0, a] * X_PB[0, e] + X[1, a] * X_PB[1, e] + X[2, a] * X_PB[2, e]
    for a in range(3):
        middle, reach, c[a] = p[a], 0.0, 0.0
        for e in range(3):
            middle += R[a, e] * 0.5 * (lower[e] + upper[e])
            reach += abs(R[a, e]) * 0.5 * (upper[e] - lower[e])
            c[a] += X_PB[e, a] * (centroid[e] - X_PB[e, 3])
        low[a], high[a] = middle - reach, middle + reach


@njit(cache=True, inline="always")
def _overlap(low, high, origin, spacing, shape):  # type: ignore[no-untyped-def]
    """Whether the axis-parallel box from low to high meets the grid."""
    meet = True
    for a in range(3):
        meet = meet and high[a] >= origin[a] and low[a] <= origin[a] + shape[a] * spacing
    return meet


@njit(cache=True, error_model="numpy")
def _gather(  # type: ignore[no-untyped-def]
    points, starts, shape, origin, spacing, R, p, c, low, high, lower, upper, first, second
):
    """The moments about c of the points in the box: their number, depth below z = 0, and least square distance from c.

    Their sum goes into first (3,), the lower triangle of the sum of their products into second (3, 3).
    """
    count, depth, nearest = 0, 0.0, np.inf
    first[:] = 0.0
    second[:] = 0.0
    if not _overlap(low, high, origin, spacing, shape):
        return count, depth, nearest
    nx, ny, nz = shape
    inverse = 1.0 / spacing
    y_first, y_end = slot_of(low[1], origin[1], inverse, ny), slot_of(high[1], origin[1], inverse, ny) + 1
    z_first, z_end = slot_of(low[2], origin[2], inverse, nz), slot_of(high[2], origin[2], inverse, nz) + 1
    for i in range(slot_of(low[0], origin[0], inverse, nx), slot_of(high[0], origin[0], inverse, nx) + 1):
        for j in range(y_first, y_end):
            column = (i * ny + j) * nz
            for n in range(starts[column + z_first], starts[column + z_end]):
                dx, dy, dz = points[n, 0] - p[0], points[n, 1] - p[1], points[n, 2] - p[2]
                z = R[0, 2] * dx + R[1, 2] * dy + R[2, 2] * dz
                if z < lower[2] or z > upper[2]:
                    continue
                x = R[0, 0] * dx + R[1, 0] * dy + R[2, 0] * dz
                y = R[0, 1] * dx + R[1, 1] * dy + R[2, 1] * dz
                if x < lower[0] or x > upper[0] or y < lower[1] or y > upper[1]:
                    continue
                depth += max(0.0, -z)
                count += 1
                x, y, z = x - c[0], y - c[1], z - c[2]
                nearest = min(nearest, x * x + y * y + z * z)
                first[0] += x
                first[1] += y
                first[2] += z
                second[0, 0] += x * x
                second[1, 0] += y * x
                second[1, 1] += y * y
                second[2, 0] += z * x
                second[2, 1] += z * y
                second[2, 2] += z * z
    return count, depth, nearest


@njit(cache=True, nogil=True, error_model="numpy")
def _pad_costs(  # type: ignore[no-untyped-def]
    points, starts, seeds, origin, spacing, X_PB, lower, upper, centroid, covariance, weights, X_PO, costs
):
    """Algorithm 5.2's cost of each pad at each pose, m, into costs (B, k).

    Few poses need the nearest point: where a point of the box is within the gate of the centroid, so is the nearest.
    """
    gate, h1, h2, h3 = weights
    R, p, c, low, high = np.empty((3, 3)), np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    first, second, q = np.empty(3), np.empty((3, 3)), np.empty(3)
    for b in range(X_PO.shape[0]):
        X = X_PO[b]
        for k in range(costs.shape[1]):
            _place(X, X_PB[k], lower[k], upper[k], centroid[k], R, p, c, low, high)
            count, depth, nearest = _gather(
                points, starts, seeds.shape, origin, spacing, R, p, c, low, high, lower[k], upper[k], first, second
            )
            distance = 0.0
            if count <= 3 or nearest > gate * gate:
                to_object(X, centroid[k], q)
                distance = np.sqrt(nearest_square(points, starts, seeds, origin, spacing, q[0], q[1], q[2]))
            matched = count > 3 and distance <= gate
            total, offset, square = h1 * distance, 0.0, 0.0
            for a in range(3):
                for e in range(a + 1):
                    difference = -covariance[k, a, e]
                    if matched:
                        difference += (second[a, e] - first[a] * first[e] / count) / (count - 1)
                    square += difference * difference * (1.0 if a == e else 2.0)
                offset += first[a] * first[a]
            if matched:
                total = np.sqrt(offset) / count + h2 * depth
            if not np.isnan(covariance[k, 0, 0]):
                total += h3 * np.sqrt(square)
            costs[b, k] = total
