"""The poses that lay two contacts on two surface samples, and their cost on the coarse field."""

from typing import NamedTuple

import numpy as np

from tactopose_drake.core.compilation import (
    Bytes2,
    Floats1,
    Floats2,
    Ints1,
    Longs1,
    Longs2,
    OutFloats3,
    OutSingles1,
    Shape3,
    Shorts2,
    inlined,
    kernel,
)
from tactopose_drake.core.kernels.sorting_kernels import select, sort_stably
from tactopose_drake.core.searches.pairs.image_kernels import Images, is_near, may_be_near


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


@inlined
def _axes(x, y, z):
    """Three axes as rows: x along a vector, any y and z.

    Source: T. Duff et al., Building an orthonormal basis, revisited, J. Comput. Graph. Tech. 6, 2017.
    """
    length = np.sqrt(x * x + y * y + z * z)
    x, y, z = x / length, y / length, z / length
    sign = 1.0 if z >= 0.0 else -1.0
    a = -1.0 / (sign + z)
    b = x * y * a
    return (x, y, z), (1.0 + sign * x * x * a, sign * b, -sign * x), (b, sign + y * y * a, -y)


@inlined
def _lay_out(table, first, second, order, inverse_spacing, frame, contacts):
    """The contacts' frame, and the contacts in it.

    The frame (4, 3) is the point between two of them, and axes, x from the first to the second. Contacts (k, 8), in
    this order, are points, in voxels from there, and normals along the axes, and the weights of `contact_table`.
    """
    x, y, z = _axes(
        table[second, 0] - table[first, 0], table[second, 1] - table[first, 1], table[second, 2] - table[first, 2]
    )
    for c in range(3):
        frame[0, c] = 0.5 * (table[first, c] + table[second, c])
        frame[1, c], frame[2, c], frame[3, c] = x[c], y[c], z[c]
    for place in range(order.shape[0]):
        m = order[place]
        for c in range(3):
            along, normal = 0.0, 0.0
            for d in range(3):
                along += frame[1 + c, d] * (table[m, d] - frame[0, d])
                normal += frame[1 + c, d] * table[m, 3 + d]
            contacts[place, c], contacts[place, 3 + c] = along * inverse_spacing, normal
        contacts[place, 6], contacts[place, 7] = table[m, 6], table[m, 7]


@inlined
def _place(samples, i, j, contacts, spin, spins):
    """Where a match and spin lays the contacts' frame in O: the point between the samples, and its axes.

    The pair's own contacts are the last two of `contacts`, which has their normals across the line between them.
    """
    points, normals = samples.points, samples.normals
    along, y, z = _axes(points[j, 0] - points[i, 0], points[j, 1] - points[i, 1], points[j, 2] - points[i, 2])
    middle = (
        0.5 * (points[i, 0] + points[j, 0]),
        0.5 * (points[i, 1] + points[j, 1]),
        0.5 * (points[i, 2] + points[j, 2]),
    )
    if spins == 1:
        cosine, sine = 1e-30, 0.0  # Normals along the line leave the spin at zero.
        last = contacts.shape[0] - 2
        for k, row in ((i, last), (j, last + 1)):
            across = normals[k, 0] * y[0] + normals[k, 1] * y[1] + normals[k, 2] * y[2]
            up = normals[k, 0] * z[0] + normals[k, 1] * z[1] + normals[k, 2] * z[2]
            cosine += across * contacts[row, 4] + up * contacts[row, 5]
            sine += across * contacts[row, 5] - up * contacts[row, 4]
        scale = 1.0 / np.sqrt(cosine * cosine + sine * sine)
        cosine, sine = cosine * scale, sine * scale
    else:
        angle = 2.0 * np.pi * spin / spins
        cosine, sine = np.cos(angle), np.sin(angle)
    # The frame's y and z are where its own normals are laid on the samples'.
    y_frame = cosine * y[0] - sine * z[0], cosine * y[1] - sine * z[1], cosine * y[2] - sine * z[2]
    z_frame = sine * y[0] + cosine * z[0], sine * y[1] + cosine * z[1], sine * y[2] + cosine * z[2]
    return middle, along, y_frame, z_frame


@inlined
def _fill_pose(frame, middle, x, y, z, X):
    """The pose X (3, 4) at which the contacts' frame is at this place in O."""
    for a in range(3):
        X[a, 3] = frame[0, a]
        for b in range(3):
            X[a, b] = frame[1, a] * x[b] + frame[2, a] * y[b] + frame[3, a] * z[b]
            X[a, 3] -= X[a, b] * middle[b]


@inlined
def coarse_cost(field, contacts, middle, x, y, z, limit):
    """Sum of the squared whitened differences of contacts (k, 8), or some number beyond the limit.

    The contacts are those of `_lay_out`, whose frame has this middle, m, and these axes in O.
    """
    values, origin, inverse_spacing, steps = field.values, field.origin, field.inverse_spacing, field.steps
    nx, ny, nz = field.shape
    # Voxels from the first one's centre.
    u0 = (middle[0] - origin[0]) * inverse_spacing
    v0 = (middle[1] - origin[1]) * inverse_spacing
    w0 = (middle[2] - origin[2]) * inverse_spacing
    total = 0.0
    for m in range(contacts.shape[0]):
        px, py, pz = contacts[m, 0], contacts[m, 1], contacts[m, 2]
        u = u0 + px * x[0] + py * y[0] + pz * z[0]
        v = v0 + px * x[1] + py * y[1] + pz * z[1]
        w = w0 + px * x[2] + py * y[2] + pz * z[2]
        a, b, c = min(max(u, 0.0), nx - 1.0), min(max(v, 0.0), ny - 1.0), min(max(w, 0.0), nz - 1.0)
        at = np.uintp((int(a + 0.5) * ny + int(b + 0.5)) * nz + int(c + 0.5))
        d = float(values[at, 0])
        if u != a or v != b or w != c:
            d += steps * np.sqrt((u - a) ** 2 + (v - b) ** 2 + (w - c) ** 2)
        total += d * d * contacts[m, 6]
        if contacts[m, 7] > 0.0:
            n0, n1, n2 = contacts[m, 3], contacts[m, 4], contacts[m, 5]
            e = values[at, 1] * (1.0 / 127.0) - (n0 * x[0] + n1 * y[0] + n2 * z[0])
            f = values[at, 2] * (1.0 / 127.0) - (n0 * x[1] + n1 * y[1] + n2 * z[1])
            g = values[at, 3] * (1.0 / 127.0) - (n0 * x[2] + n1 * y[2] + n2 * z[2])
            total += (e * e + f * f + g * g) * contacts[m, 7]
        if total > limit:
            break
    return total


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
    X, frames = np.empty((3, 4)), np.empty((spins.shape[0], 4, 3))
    contacts = np.empty((spins.shape[0], table.shape[0], table.shape[1]))
    count, used, limit, is_anywhere = cost.shape[0], 0, np.inf, images.farthest == np.inf
    # A pose is kept as its pair, its match and its spin. There may be twice as many as are wanted, then half are left:
    # soon most poses cost more than is worth adding up.
    room = 2 * count
    for q in range(spins.shape[0]):
        room = max(room, 2 * count + spins[q])
    kept, kept_cost = np.empty((room, 3), dtype=np.int32), np.empty(room, dtype=np.float32)
    spare = np.empty(room, dtype=np.float32)
    order = np.empty(table.shape[0], dtype=np.intp)
    for q in range(spins.shape[0]):
        _put_last(ends[q, 0], ends[q, 1], order)
        frame, laid = frames[q], contacts[q]
        _lay_out(table, ends[q, 0], ends[q, 1], order, field.inverse_spacing, frame, laid)
        for row in range(begins[q], begins[q + 1]):
            i, j = pairs[matches[row], 0], pairs[matches[row], 1]
            if not is_anywhere and not may_be_near(samples.points, i, j, frame, images):
                continue
            for spin in range(spins[q]):
                middle, x, y, z = _place(samples, i, j, laid, spin, spins[q])
                if not is_anywhere:
                    _fill_pose(frame, middle, x, y, z, X)
                    if not is_near(X, images):
                        continue
                total = coarse_cost(field, laid, middle, x, y, z, max(limit, alike))
                if total < alike:
                    total = alike * _chance(row, spin)
                if total <= limit:
                    kept[used, 0], kept[used, 1], kept[used, 2] = q, row, spin
                    kept_cost[used] = total
                    used += 1
            if used >= 2 * count:
                limit, used = _drop_worse(count, used, kept, kept_cost, spare)
    if used > count:
        limit, used = _drop_worse(count, used, kept, kept_cost, spare)
    rising, places = np.empty(used), np.empty((2, used), dtype=np.int64)
    for k in range(used):
        rising[k] = kept_cost[k]
    sort_stably(rising, places[0], places[1])
    for place in range(used):
        k = places[0, place]
        q, row, spin = kept[k, 0], kept[k, 1], kept[k, 2]
        i, j = pairs[matches[row], 0], pairs[matches[row], 1]
        middle, x, y, z = _place(samples, i, j, contacts[q], spin, spins[q])
        _fill_pose(frames[q], middle, x, y, z, X_best[place])
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
def _drop_worse(count, used, kept, cost, spare):
    """Keeps of the first `used`, which are more than `count`, those that cost least; the largest cost, and `count`."""
    for k in range(used):
        spare[k] = cost[k]
    limit, now = select(spare, used, count - 1), 0
    for k in range(used):
        if cost[k] <= limit and now < count:
            kept[now, 0], kept[now, 1], kept[now, 2] = kept[k, 0], kept[k, 1], kept[k, 2]
            cost[now] = cost[k]
            now += 1
    return limit, now
