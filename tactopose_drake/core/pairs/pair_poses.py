"""The poses that lay two contacts on two surface samples, judged by all contacts.

Two points fix a pose but for its spin about the line between them. Normals fix the spin too: the best one in the least
squares sense turns the samples' normals, seen along the line, onto the contacts' [K76]. Where there are no normals, or
both lie along the line, the spin is free, and turns of a full circle are tried.

Source: [K76] W. Kabsch, A solution for the best rotation to relate two sets of vectors, Acta Cryst. A32, 1976.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from tactopose_drake.core.pairs.pair_features import PairFeatures
from tactopose_drake.core.shape.coarse_field import CoarseField
from tactopose_drake.core.validation import FloatArray


@dataclass(frozen=True, eq=False)
class ContactPair:
    """Two contacts, and the surface samples that they may lie on.

    Attributes:
        first, second: the contacts' indices.
        matches: indices of pairs of samples, shape (matches,).
        spins: how many turns about the line between the contacts each match stands for; 1: the one that fits the
            normals best.
    """

    first: int
    second: int
    matches: NDArray[np.int32]
    spins: int

    @property
    def count(self) -> int:
        """The number of its poses."""
        return len(self.matches) * self.spins


def judge_pairs(
    pairs: Sequence[ContactPair],
    features: PairFeatures,
    field: CoarseField,
    table: FloatArray,
    count: int,
    center: FloatArray,
    reach: tuple[float, float],
    turns: FloatArray,
) -> NDArray[np.float32]:
    """Coarse costs of all poses of the pairs, one pair after the other, shape (sum of their counts,).

    Infinite are those of poses out of reach, and of some that are certainly not among the `count` best. A pose is in
    reach when one of its images is, which the object's symmetries make: of those only one is looked up.

    Args:
        pairs: contacts and their matches.
        features: the object's pairs of samples.
        field: the object's coarse field.
        table: all contacts, from `coarse_field.contact_table`.
        count: how many of the best are of interest.
        center: the middle of the poses that count, shape (3, 4).
        reach: the largest rotation from there, rad, and the largest translation, m.
        turns: the object's symmetries as poses X_OO', shape (g, 3, 4).
    """
    matches, begins, ends, frames, spins = _joined(pairs, table)
    cost = np.empty(sum(pair.count for pair in pairs), dtype=np.float32)
    arguments = (
        features.points,
        features.normals,
        features.pairs,
        matches,
        begins,
        ends,
        frames,
        spins,
        field.values,
        field.shape,
        field.origin,
        1.0 / field.spacing,
        field.spacing / field.step,
        table,
        count,
        np.ascontiguousarray(center[:, :3] @ np.swapaxes(turns[:, :, :3], 1, 2)),
        np.ascontiguousarray(turns[:, :, 3]),
        center[:, 3],
        1.0 + 2.0 * np.cos(reach[0]) if reach[0] < np.pi else -np.inf,
        reach[1] ** 2,
    )
    _judge(*arguments, cost)
    return cost


def pair_poses(
    pairs: Sequence[ContactPair], features: PairFeatures, table: FloatArray, chosen: NDArray[np.intp]
) -> FloatArray:
    """The poses (chosen, 3, 4) of the chosen ones among those that `judge_pairs` judges."""
    X_PO = np.empty((len(chosen), 3, 4))
    matches, begins, _, frames, spins = _joined(pairs, table)
    _make(features.points, features.normals, features.pairs, matches, begins, frames, spins, chosen, X_PO)
    return X_PO


def _joined(
    pairs: Sequence[ContactPair], table: FloatArray
) -> tuple[NDArray[np.int32], NDArray[np.intp], NDArray[np.intp], FloatArray, NDArray[np.int64]]:
    """All matches, the number of them before each pair (q + 1,), the pairs' contacts (q, 2), their frames (q, 6, 3) and
    spins (q,).
    """
    begins = np.cumsum([0] + [len(pair.matches) for pair in pairs])
    ends, frames = np.array([(pair.first, pair.second) for pair in pairs]), np.empty((len(pairs), 6, 3))
    _contact_frames(table, ends, frames)
    matches = np.concatenate([pair.matches for pair in pairs])
    return matches, begins, ends, frames, np.array([pair.spins for pair in pairs])


def distinct_poses(X_PO: FloatArray, length: float, angle: float) -> NDArray[np.bool_]:
    """Marks, of poses (B, 3, 4), the first in each cell of this size, m and about rad; shape (B,)."""
    distinct = np.empty(len(X_PO), dtype=np.bool_)
    _mark_first_in_cell(X_PO, 1.0 / length, 1.0 / angle, distinct)
    return distinct


@njit(cache=True, inline="always")
def _axes(p, q, axes, middle):  # type: ignore[no-untyped-def]
    """Axes (rows) at two points, x from one to the other, any y and z; and the point between them."""
    for a in range(3):
        axes[0, a] = q[a] - p[a]
        middle[a] = 0.5 * (p[a] + q[a])
    scale = 1.0 / np.sqrt(axes[0, 0] ** 2 + axes[0, 1] ** 2 + axes[0, 2] ** 2)
    x, y, z = axes[0, 0] * scale, axes[0, 1] * scale, axes[0, 2] * scale
    axes[0, 0], axes[0, 1], axes[0, 2] = x, y, z
    if abs(x) < 0.6:
        scale = 1.0 / np.sqrt(y * y + z * z)
        axes[1, 0], axes[1, 1], axes[1, 2] = 0.0, z * scale, -y * scale
    else:
        scale = 1.0 / np.sqrt(x * x + y * y)
        axes[1, 0], axes[1, 1], axes[1, 2] = y * scale, -x * scale, 0.0
    axes[2, 0] = y * axes[1, 2] - z * axes[1, 1]
    axes[2, 1] = z * axes[1, 0] - x * axes[1, 2]
    axes[2, 2] = x * axes[1, 1] - y * axes[1, 0]


@njit(cache=True)
def _contact_frames(table, ends, frames):  # type: ignore[no-untyped-def]
    """Rows: the point between two contacts; axes, x from the first to the second; y and z of each normal, (6, 3)."""
    for q in range(ends.shape[0]):
        frame = frames[q]
        frame[4:] = 0.0
        _axes(table[ends[q, 0], :3], table[ends[q, 1], :3], frame[1:4], frame[0])
        for end in range(2):
            for axis in range(2):
                for c in range(3):
                    frame[4 + end, axis] += table[ends[q, end], 3 + c] * frame[2 + axis, c]


@njit(cache=True, inline="always")
def _pair_pose(points, normals, i, j, axes, middle, frame, spin, spins, X):  # type: ignore[no-untyped-def]
    """The pose of one match and spin, into X (3, 4)."""
    if spins == 1:
        cosine, sine = 1e-30, 0.0  # Normals along the line leave the spin at zero.
        for k, row in ((i, 4), (j, 5)):
            n = normals[k]
            y = n[0] * axes[1, 0] + n[1] * axes[1, 1] + n[2] * axes[1, 2]
            z = n[0] * axes[2, 0] + n[1] * axes[2, 1] + n[2] * axes[2, 2]
            cosine += y * frame[row, 0] + z * frame[row, 1]
            sine += y * frame[row, 1] - z * frame[row, 0]
        scale = 1.0 / np.sqrt(cosine * cosine + sine * sine)
        cosine, sine = cosine * scale, sine * scale
    else:
        angle = 2.0 * np.pi * spin / spins
        cosine, sine = np.cos(angle), np.sin(angle)
    for a in range(3):
        x = frame[1, a]
        y, z = cosine * frame[2, a] + sine * frame[3, a], cosine * frame[3, a] - sine * frame[2, a]
        X[a, 3] = frame[0, a]
        for b in range(3):
            X[a, b] = x * axes[0, b] + y * axes[1, b] + z * axes[2, b]
            X[a, 3] -= X[a, b] * middle[b]


# Beside its caller, because numba's cache on disk notices changes of the caller's file alone.
@njit(cache=True, inline="always", error_model="numpy")
def coarse_cost(values, shape, origin, inverse_spacing, steps, table, order, X, limit):  # type: ignore[no-untyped-def]
    """Sum of the squared whitened differences at the pose X (3, 4), or some number beyond the limit.

    The contacts' `table` is that of `contact_table`, read in this order; `steps` is how many steps of the distance are
    in a voxel.
    """
    nx, ny, nz = shape
    total = 0.0
    for m in order:
        x, y, z = table[m, 0] - X[0, 3], table[m, 1] - X[1, 3], table[m, 2] - X[2, 3]
        # Voxels from the first one's centre.
        u = (X[0, 0] * x + X[1, 0] * y + X[2, 0] * z - origin[0]) * inverse_spacing
        v = (X[0, 1] * x + X[1, 1] * y + X[2, 1] * z - origin[1]) * inverse_spacing
        w = (X[0, 2] * x + X[1, 2] * y + X[2, 2] * z - origin[2]) * inverse_spacing
        a, b, c = min(max(u, 0.0), nx - 1.0), min(max(v, 0.0), ny - 1.0), min(max(w, 0.0), nz - 1.0)
        at = np.uintp((int(a + 0.5) * ny + int(b + 0.5)) * nz + int(c + 0.5))
        d = float(values[at, 0])
        if u != a or v != b or w != c:
            d += steps * np.sqrt((u - a) ** 2 + (v - b) ** 2 + (w - c) ** 2)
        total += d * d * table[m, 6]
        if table[m, 7] > 0.0:
            n0, n1, n2 = table[m, 3], table[m, 4], table[m, 5]
            e = values[at, 1] / 127.0 - (X[0, 0] * n0 + X[1, 0] * n1 + X[2, 0] * n2)
            f = values[at, 2] / 127.0 - (X[0, 1] * n0 + X[1, 1] * n1 + X[2, 1] * n2)
            g = values[at, 3] / 127.0 - (X[0, 2] * n0 + X[1, 2] * n1 + X[2, 2] * n2)
            total += (e * e + f * f + g * g) * table[m, 7]
        if total > limit:
            break
    return total


@njit(cache=True, inline="always")
def _is_near(X, rotations, origins, center, least_trace, farthest):  # type: ignore[no-untyped-def]
    """Whether an image of the pose X, by one of g symmetries, is near enough to the centre.

    Its rotation there is compared with X's by `rotations` (g, 3, 3), its origin is X's point `origins` (g, 3).
    """
    for s in range(rotations.shape[0]):
        distance, trace = 0.0, 0.0
        for a in range(3):
            way = X[a, 3] - center[a]
            for b in range(3):
                way += X[a, b] * origins[s, b]
                trace += X[a, b] * rotations[s, a, b]
            distance += way * way
        if distance <= farthest and trace >= least_trace:
            return True
    return False


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "reassoc", "nsz", "arcp"})
def _judge(  # type: ignore[no-untyped-def]
    points,
    normals,
    pairs,
    matches,
    begins,
    ends,
    frames,
    spins,
    values,
    shape,
    origin,
    inverse_spacing,
    steps,
    table,
    count,
    rotations,
    origins,
    center,
    least_trace,
    farthest,
    cost,
):
    """Every pair's matches. What is worse than the `count` best so far is not of interest."""
    axes, middle, X = np.empty((3, 3)), np.empty(3), np.empty((3, 4))
    lowest, limit, used, offset = np.empty(count + cost.shape[0], dtype=np.float32), np.inf, 0, 0
    order = np.empty(table.shape[0], dtype=np.intp)
    for q in range(spins.shape[0]):
        frame = frames[q]
        # The contacts of a pair fit by construction: the others say sooner that a pose is bad.
        place = 0
        for m in range(table.shape[0]):
            if m != ends[q, 0] and m != ends[q, 1]:
                order[place] = m
                place += 1
        order[place], order[place + 1] = ends[q, 0], ends[q, 1]
        for row in range(begins[q], begins[q + 1]):
            i, j = pairs[matches[row], 0], pairs[matches[row], 1]
            _axes(points[i], points[j], axes, middle)
            for spin in range(spins[q]):
                _pair_pose(points, normals, i, j, axes, middle, frame, spin, spins[q], X)
                at = offset + (row - begins[q]) * spins[q] + spin
                cost[at] = np.inf
                if _is_near(X, rotations, origins, center, least_trace, farthest):
                    total = coarse_cost(values, shape, origin, inverse_spacing, steps, table, order, X, limit)
                    if total <= limit:
                        cost[at] = total
                        lowest[used] = total
                        used += 1
        offset += (begins[q + 1] - begins[q]) * spins[q]
        if used > count:
            lowest[:used] = np.partition(lowest[:used], count)
            used = count
            limit = lowest[count]


@njit(cache=True)
def _make(points, normals, pairs, matches, begins, frames, spins, chosen, X):  # type: ignore[no-untyped-def]
    axes, middle = np.empty((3, 3)), np.empty(3)
    for row in range(chosen.shape[0]):
        q, rest = 0, chosen[row]
        while rest >= (begins[q + 1] - begins[q]) * spins[q]:
            rest -= (begins[q + 1] - begins[q]) * spins[q]
            q += 1
        match = matches[begins[q] + rest // spins[q]]
        i, j = pairs[match, 0], pairs[match, 1]
        _axes(points[i], points[j], axes, middle)
        _pair_pose(points, normals, i, j, axes, middle, frames[q], rest % spins[q], spins[q], X[row])


@njit(cache=True)
def _mark_first_in_cell(X, per_length, per_angle, distinct):  # type: ignore[no-untyped-def]
    """By a table of hashes: cells that share all 64 bits are taken for one."""
    size = 16
    while size < 4 * X.shape[0]:
        size *= 2
    table = np.zeros(size, dtype=np.uint64)
    for b in range(X.shape[0]):
        key = np.uint64(14695981039346656037)
        for a in range(3):
            for c in range(1, 4):  # Two columns of the rotation say the third.
                cell = np.int64(np.floor(X[b, a, c] * (per_length if c == 3 else per_angle)))
                key = (key ^ np.uint64(cell)) * np.uint64(1099511628211)
        key |= np.uint64(1)
        place = np.int64(key >> np.uint64(32)) & (size - 1)
        while table[place] != 0 and table[place] != key:
            place = (place + 1) & (size - 1)
        distinct[b] = table[place] == 0
        table[place] = key
