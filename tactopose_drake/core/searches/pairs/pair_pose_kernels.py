"""The poses that lay two contacts on two surface samples, and their cost on the coarse field."""

from typing import NamedTuple

import numpy as np

from tactopose_drake.core.compilation import (
    Bytes2,
    Floats1,
    Floats2,
    Floats3,
    Ints1,
    Longs1,
    Longs2,
    OutFloats1,
    OutFloats2,
    OutFloats3,
    OutSingles1,
    Shape3,
    Shorts2,
    inlined,
    kernel,
)
from tactopose_drake.core.kernels.sorting_kernels import select, sort_stably


class Samples(NamedTuple):
    """An object's surface samples (n, 3), their normals (n, 3), and pairs of them (m, 2); read-only."""

    points: Floats2
    normals: Floats2
    pairs: Shorts2


class Matched(NamedTuple):
    """The fields of `MatchedPairs`; read-only."""

    matches: Ints1
    begins: Longs1
    ends: Longs2
    spins: Longs1


class Field(NamedTuple):
    """A `CoarseField`, read-only, with one over its spacing, 1/m, and the steps of the distance in a voxel."""

    values: Bytes2
    shape: Shape3
    origin: Floats1
    inverse_spacing: float
    steps: float


class Images(NamedTuple):
    """Which poses are near enough to a centre by one of g symmetries; read-only.

    Attributes:
        rotations: with which a pose's rotation is compared, shape (g, 3, 3).
        origins: the images' origins in O, shape (g, 3), m.
        center: of the poses' origins, shape (3,), m.
        least_trace: of the product of rotations that are near enough.
        farthest: the square of the largest distance, m^2.
    """

    rotations: Floats3
    origins: Floats2
    center: Floats1
    least_trace: float
    farthest: float


class Frames(NamedTuple):
    """Axes (3, 3) at two samples, the point between them (3,), and the contacts' frame (6, 3), see `_contact_frame`."""

    axes: OutFloats2
    middle: OutFloats1
    frame: OutFloats2


@inlined
def _axes(p, q, axes, middle):
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


@inlined
def _contact_frame(first, second, frame):
    """Of two rows of `contact_table` into the frame (6, 3): the point between them; axes, x from the first to the
    second; y and z of each normal.
    """
    _axes(first[:3], second[:3], frame[1:4], frame[0])
    for axis in range(2):
        frame[4, axis], frame[5, axis] = 0.0, 0.0
        for c in range(3):
            frame[4, axis] += first[3 + c] * frame[2 + axis, c]
            frame[5, axis] += second[3 + c] * frame[2 + axis, c]


@inlined
def _pair_pose(normals, i, j, frames, spin, spins, X):
    """The pose of one match and spin, into X (3, 4)."""
    axes, middle, frame = frames
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


@inlined
def coarse_cost(field, table, order, X, limit):
    """Sum of the squared whitened differences at the pose X (3, 4), or some number beyond the limit.

    The contacts' `table` is that of `contact_table`, read in this order.
    """
    values, origin, inverse_spacing, steps = field.values, field.origin, field.inverse_spacing, field.steps
    nx, ny, nz = field.shape
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


@inlined
def _is_near(X, images):
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


@kernel
def keep_best(
    samples: Samples,
    matched: Matched,
    field: Field,
    table: Floats2,
    images: Images,
    alike: float,
    X_best: OutFloats3,
    cost: OutSingles1,
) -> int:
    """Fills the poses and costs, and returns their number. What is worse than so many already is left as it is.

    Costs below `alike` tell nothing: which of such poses counts as the better one is left to chance.
    """
    pairs = samples.pairs
    matches, begins, ends, spins = matched
    axes, middle, X, frame = np.empty((3, 3)), np.empty(3), np.empty((3, 4)), np.empty((6, 3))
    count, used, limit = cost.shape[0], 0, np.inf
    # A pose is kept as its pair, its match and its spin; before a pair is done, there may be more than are wanted.
    room = 0
    for q in range(spins.shape[0]):
        room = max(room, count + (begins[q + 1] - begins[q]) * spins[q])
    kept, kept_cost = np.empty((room, 3), dtype=np.int32), np.empty(room, dtype=np.float32)
    spare = np.empty(room, dtype=np.float32)
    order = np.empty(table.shape[0], dtype=np.intp)
    for q in range(spins.shape[0]):
        a, b = ends[q, 0], ends[q, 1]
        _contact_frame(table[a], table[b], frame)
        _put_last(a, b, order)
        for row in range(begins[q], begins[q + 1]):
            i, j = pairs[matches[row], 0], pairs[matches[row], 1]
            _axes(samples.points[i], samples.points[j], axes, middle)
            for spin in range(spins[q]):
                _pair_pose(samples.normals, i, j, Frames(axes, middle, frame), spin, spins[q], X)
                if _is_near(X, images):
                    total = coarse_cost(field, table, order, X, max(limit, alike))
                    if total < alike:
                        total = alike * _chance(row, spin)
                    if total <= limit:
                        kept[used, 0], kept[used, 1], kept[used, 2] = q, row, spin
                        kept_cost[used] = total
                        used += 1
        if used > count:
            for k in range(used):
                spare[k] = kept_cost[k]
            limit = select(spare, used, count - 1)
            used = _drop_worse(limit, count, used, kept, kept_cost)
    rising, places = np.empty(used), np.empty((2, used), dtype=np.int64)
    for k in range(used):
        rising[k] = kept_cost[k]
    sort_stably(rising, places[0], places[1])
    for place in range(used):
        k = places[0, place]
        q, row, spin = kept[k, 0], kept[k, 1], kept[k, 2]
        i, j = pairs[matches[row], 0], pairs[matches[row], 1]
        _contact_frame(table[ends[q, 0]], table[ends[q, 1]], frame)
        _axes(samples.points[i], samples.points[j], axes, middle)
        _pair_pose(samples.normals, i, j, Frames(axes, middle, frame), spin, spins[q], X_best[place])
        cost[place] = kept_cost[k]
    return used


@inlined
def _chance(row, spin):
    """A number from 0 to 1, as good as random, of a match and spin [multiplicative hashing, Knuth]."""
    return float(((row * 2654435761 + spin * 2246822519) ^ (row >> 3)) & 0xFFFFFF) / 0x1000000


@inlined
def _put_last(a, b, order):
    """The order of contacts with a pair last: it fits by construction, the others say sooner that a pose is bad."""
    place = 0
    for m in range(order.shape[0]):
        if m != a and m != b:
            order[place] = m
            place += 1
    order[place], order[place + 1] = a, b


@inlined
def _drop_worse(limit, count, used, kept, cost):
    """Keeps of the first `used` those that cost no more than the limit, `count` at the most; their number."""
    now = 0
    for k in range(used):
        if cost[k] <= limit and now < count:
            kept[now, 0], kept[now, 1], kept[now, 2] = kept[k, 0], kept[k, 1], kept[k, 2]
            cost[now] = cost[k]
            now += 1
    return now
