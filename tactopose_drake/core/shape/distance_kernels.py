"""Exact distances from the nodes of a regular grid to triangles: a band, sweeps, and the sign."""

import numpy as np

from tactopose_drake.core.compilation import inlined, kernel
from tactopose_drake.core.kernel_types import Floats1, Floats2, Ints3, OutFloats3, OutInts3, Shorts3, Singles4


@inlined
def closest_weights(t, x, y, z):
    """Weights (v, w) of the closest point a + v ab + w ac of a packed triangle. [E05] section 5.1.5."""
    px, py, pz = x - t[0], y - t[1], z - t[2]
    d1 = t[3] * px + t[4] * py + t[5] * pz
    d2 = t[6] * px + t[7] * py + t[8] * pz
    abab, abac, acac = t[9], t[10], t[11]
    if d1 <= 0.0 and d2 <= 0.0:
        return 0.0, 0.0
    d3, d4 = d1 - abab, d2 - abac
    if d3 >= 0.0 and d4 <= d3:
        return 1.0, 0.0
    vc = d1 * d4 - d3 * d2
    if vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        return d1 / (d1 - d3), 0.0
    d5, d6 = d1 - abac, d2 - acac
    if d6 >= 0.0 and d5 <= d6:
        return 0.0, 1.0
    vb = d5 * d2 - d1 * d6
    if vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        return 0.0, d2 / (d2 - d6)
    va = d3 * d6 - d5 * d4
    if va <= 0.0 and d4 >= d3 and d5 >= d6:
        w = (d4 - d3) / ((d4 - d3) + (d5 - d6))
        return 1.0 - w, w
    scale = 1.0 / (va + vb + vc)
    return vb * scale, vc * scale


@inlined
def _offset(t, x, y, z):
    """The vector from the closest point of a packed triangle to a point."""
    v, w = closest_weights(t, x, y, z)
    return x - t[0] - v * t[3] - w * t[6], y - t[1] - v * t[4] - w * t[7], z - t[2] - v * t[5] - w * t[8]


@kernel
def fill_band(
    packed: Floats2, origin: Floats1, spacing: float, band: float, nearest: OutInts3, distance: OutFloats3
) -> None:
    """Evaluates the distance of every face from the nodes within `band` of it."""
    nx, ny, nz = nearest.shape
    for f in range(packed.shape[0]):
        t = packed[f]
        i0, i1 = _node_range(t[0], t[3], t[6], origin[0], spacing, band, nx)
        j0, j1 = _node_range(t[1], t[4], t[7], origin[1], spacing, band, ny)
        k0, k1 = _node_range(t[2], t[5], t[8], origin[2], spacing, band, nz)
        for i in range(i0, i1):
            x = origin[0] + i * spacing
            for j in range(j0, j1):
                y = origin[1] + j * spacing
                above = t[12] * (x - t[0]) + t[13] * (y - t[1]) - t[14] * t[2]
                for k in range(k0, k1):
                    z = origin[2] + k * spacing
                    height = abs(above + t[14] * z)
                    if height <= band and height < distance[i, j, k]:
                        dx, dy, dz = _offset(t, x, y, z)
                        d = np.sqrt(dx * dx + dy * dy + dz * dz)
                        if d < distance[i, j, k]:
                            distance[i, j, k] = d
                            nearest[i, j, k] = f


@inlined
def _node_range(a, ab, ac, origin, spacing, band, count):
    """The nodes along one direction that lie within `band` of a triangle's extent."""
    low = a + min(0.0, ab, ac) - band
    high = a + max(0.0, ab, ac) + band
    first = max(0, int(np.ceil((low - origin) / spacing)))
    last = min(count - 1, int(np.floor((high - origin) / spacing)))
    return first, last + 1


@kernel
def sweep(
    packed: Floats2, origin: Floats1, spacing: float, band: float, nearest: OutInts3, distance: OutFloats3
) -> None:
    """Propagates the nearest faces beyond the band, once in each of the eight diagonal directions.

    The outermost layer of nodes is padding: infinitely far, and never written. A neighbour that was also behind in an
    earlier direction has been tried then; it is tried again only if its face has changed since.
    """
    nx, ny, nz = nearest.shape
    all_nearest, all_distance = nearest.reshape(-1), distance.reshape(-1)
    changed = np.zeros(all_nearest.shape[0], dtype=np.int8)  # The direction, from 1, in which a node's face was found.
    back, step, asked = np.empty(7, dtype=np.int64), np.empty(7), np.empty(7, dtype=np.int8)
    for octant in range(8):
        si, sj, sk = 1 - 2 * (octant & 1), 1 - (octant & 2), 1 - ((octant & 4) >> 1)
        for n in range(7):
            a, b, c = (n + 1) & 1, ((n + 1) >> 1) & 1, (n + 1) >> 2
            back[n] = (a * si * ny + b * sj) * nz + c * sk
            step[n] = np.sqrt(a + b + c) * spacing
            asked[n] = 0
            for earlier in range(octant):
                if (earlier ^ octant) & (n + 1) == 0:
                    asked[n] = earlier + 1
        for ii in range(1, nx - 1):
            i = ii if si > 0 else nx - 1 - ii
            x = origin[0] + i * spacing
            for jj in range(1, ny - 1):
                j = jj if sj > 0 else ny - 1 - jj
                y = origin[1] + j * spacing
                for kk in range(1, nz - 1):
                    k = kk if sk > 0 else nz - 1 - kk
                    here = np.uint64((i * ny + j) * nz + k)
                    best = all_distance[here]
                    if best <= band:
                        continue
                    z = origin[2] + k * spacing
                    face = all_nearest[here]
                    tried = face
                    for n in range(7):
                        there = np.uint64((i * ny + j) * nz + k - back[n])
                        if changed[there] <= asked[n] and asked[n] > 0:
                            continue
                        candidate = all_nearest[there]
                        # A face is at least as far as its distance from the neighbour minus the step.
                        if candidate == face or candidate == tried or all_distance[there] - step[n] >= best:
                            continue
                        tried = candidate
                        t = packed[candidate]
                        height = t[12] * (x - t[0]) + t[13] * (y - t[1]) + t[14] * (z - t[2])
                        if height * height >= best * best:
                            continue  # Not even its plane is nearer.
                        dx, dy, dz = _offset(t, x, y, z)
                        square = dx * dx + dy * dy + dz * dz
                        if square < best * best:
                            best, face = np.sqrt(square), candidate
                    if face != all_nearest[here]:
                        all_distance[here], all_nearest[here], changed[here] = best, face, octant + 1


@kernel
def signed_field(packed: Floats2, nearest: Ints3, winding: Shorts3, origin: Floats1, spacing: float) -> Singles4:
    """Signed distance and unit gradient at every node, shape (nx, ny, nz, 4), float32.

    The gradient points from the closest point to the node (outside) or the other way (inside). On the surface, where
    that direction is lost in rounding, it is the face's normal.
    """
    nx, ny, nz = nearest.shape
    values = np.empty((nx, ny, nz, 4), dtype=np.float32)
    on_surface = 1e-5 * spacing
    for i in range(nx):
        x = origin[0] + i * spacing
        for j in range(ny):
            y = origin[1] + j * spacing
            for k in range(nz):
                z = origin[2] + k * spacing
                t = packed[nearest[i, j, k]]
                dx, dy, dz = _offset(t, x, y, z)
                d = np.sqrt(dx * dx + dy * dy + dz * dz)
                sign = -1.0 if winding[i, j, k] >= 1 else 1.0
                values[i, j, k, 0] = sign * d
                if d > on_surface:
                    values[i, j, k, 1] = sign * dx / d
                    values[i, j, k, 2] = sign * dy / d
                    values[i, j, k, 3] = sign * dz / d
                else:
                    values[i, j, k, 1] = t[12]
                    values[i, j, k, 2] = t[13]
                    values[i, j, k, 3] = t[14]
    return values
