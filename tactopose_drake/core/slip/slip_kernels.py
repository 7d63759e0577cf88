"""The residuals of fingertips and contacts over the latest frames, compiled.

See `slip_by_surface.py` and `slip_by_motion.py`.
"""

import numpy as np

from tactopose_drake.core.compilation import kernel, part
from tactopose_drake.core.kernel_types import Floats1, Floats2, Floats3, Longs1, OutFloats1, OutFloats2, OutFloats3


@kernel
def add_displacements(
    source: Longs1, p: Floats2, velocity: Floats2, duration: float, displacements: OutFloats3, squares: OutFloats1
) -> int:
    """Returns how many of the k touching fingertips touched in all frames, and sums squares of their displacements.

    Args:
        source: of each fingertip that touches now, shape (k,).
        p: where it touches, shape (k, 3), m.
        velocity: its spatial velocity [w, v], shape (k, 6).
        duration: of the frame, s.
        displacements: in h frames, by source, oldest first, shape (h, s, 3); NaN where a source did not touch. Those of
            the last frame are written.
        squares: output, sums of squares over these fingertips: of the residual of the best small rigid motion for their
            total displacements; likewise for the changes of the displacement from the last frame but one to the last;
            and of the total displacements, shape (3,), m^2.
    """
    h, k, now = displacements.shape[0], p.shape[0], displacements[displacements.shape[0] - 1]
    arms, ways, changes = np.empty((k, 3)), np.empty((k, 3)), np.empty((k, 3))
    steady = 0
    for i in range(k):
        s, x, y, z, w0, w1, w2 = source[i], p[i, 0], p[i, 1], p[i, 2], velocity[i, 0], velocity[i, 1], velocity[i, 2]
        now[s, 0] = duration * (w1 * z - w2 * y + velocity[i, 3])
        now[s, 1] = duration * (w2 * x - w0 * z + velocity[i, 4])
        now[s, 2] = duration * (w0 * y - w1 * x + velocity[i, 5])
        for a in range(3):
            arms[steady, a], ways[steady, a] = p[i, a], 0.0
            for f in range(h):
                ways[steady, a] += displacements[f, s, a]
            changes[steady, a] = now[s, a] - displacements[max(h - 2, 0), s, a]
        steady += 0 if np.isnan(ways[steady, 0]) else 1
    squares[2] = 0.0
    for i in range(steady):
        for a in range(3):
            squares[2] += ways[i, a] ** 2
    _take_mean(arms, steady)
    squares[0], squares[1] = _unexplained(arms, ways, steady), _unexplained(arms, changes, steady)
    return steady


@part
def _take_mean(rows: OutFloats2, count: int) -> None:
    """Subtracts the mean from the first rows (count, 3)."""
    for a in range(3):
        mean = 0.0
        for i in range(count):
            mean += rows[i, a] / count
        for i in range(count):
            rows[i, a] -= mean


@part
def _unexplained(arms: Floats2, ways: OutFloats2, count: int) -> float:
    """The squared residual of the best small rigid motion for displacements (count, 3) of points with centred arms.

    The translation is the mean displacement, which is subtracted from `ways`. The rotation is the least-squares one, by
    the adjugate of the inertia [[a, d, e], [d, b, f], [e, f, c]], regularised for points on a line.
    """
    _take_mean(ways, count)
    a = b = c = d = e = f = 0.0
    r = s = t = 0.0
    for i in range(count):
        x, y, z, u, v, w = arms[i, 0], arms[i, 1], arms[i, 2], ways[i, 0], ways[i, 1], ways[i, 2]
        a, b, c = a + y * y + z * z, b + x * x + z * z, c + x * x + y * y
        d, e, f = d - x * y, e - x * z, f - y * z
        r, s, t = r + y * w - z * v, s + z * u - x * w, t + x * v - y * u
    held = 1e-9 * (a + b + c) + 1e-30
    a, b, c = a + held, b + held, c + held
    A, B, C, D, E, F = b * c - f * f, a * c - e * e, a * b - d * d, e * f - c * d, d * f - b * e, d * e - a * f
    scale = 1.0 / (a * A + d * D + e * E)
    r, s, t = scale * (A * r + D * s + E * t), scale * (D * r + B * s + F * t), scale * (E * r + F * s + C * t)
    square = 0.0
    for i in range(count):
        x, y, z = arms[i, 0], arms[i, 1], arms[i, 2]
        u, v, w = ways[i, 0] - (s * z - t * y), ways[i, 1] - (t * x - r * z), ways[i, 2] - (r * y - s * x)
        square += u * u + v * v + w * w
    return square


@kernel
def follow_residuals(
    before: Floats3,
    residuals: Floats3,
    source: Longs1,
    gain: float,
    bounds: Floats1,
    noise: OutFloats1,
    after: OutFloats3,
) -> None:
    """Appends the current residuals to their history, and updates the noise.

    Args:
        before: residuals of the latest h frames, by source, shape (h, s', 4); NaN where a source did not touch.
        residuals: of k contacts now, at the pose of the history and at another one, shape (2, k, 4).
        source: of each contact, shape (k,).
        gain: of the exponential smoothing of the noise.
        bounds: to which each frame's estimate of the noise is clipped, shape (2,).
        noise: variances of what is new in distances and in normals at each frame, shape (2,); updated.
        after: output, the latest frames up to now, transferred to the other pose, shape (h', s, 4).
    """
    h, kept, again, of_points, of_normals = before.shape[0], after.shape[0], 0, 0.0, 0.0
    for f in range(kept):
        for s in range(after.shape[1]):
            for k in range(4):
                after[f, s, k] = np.nan
    for i in range(source.shape[0]):
        s = source[i]
        is_known = h > 0 and s < before.shape[1]
        for k in range(4):
            now = residuals[0, i, k]
            shift = residuals[1, i, k] - now
            after[kept - 1, s, k] = now + shift
            if is_known:
                for f in range(kept - 1):
                    after[f, s, k] = before[h - kept + 1 + f, s, k] + shift
                change = now - before[h - 1, s, k]
                if not np.isnan(change):
                    again += 1
                    of_points += change * change if k == 0 else 0.0
                    of_normals += change * change if k > 0 else 0.0
    if again > 0:
        # Mean squares of changes are twice the variance. `again` counts four rows per contact; two of a normal's vary.
        noise[0] += gain * (min(max(2.0 * of_points / again, bounds[0]), bounds[1]) - noise[0])
        noise[1] += gain * (min(max(of_normals / again, bounds[0]), bounds[1]) - noise[1])


@kernel
def compare_frames(
    history: Floats3, source: Longs1, noise: Floats2, recent: int, earlier: int, comparison: OutFloats2
) -> float:
    """Compares the mean residuals of the latest frames with those of earlier ones.

    Args:
        history: residuals by source, oldest first, shape (h, s, 4); NaN where a source did not touch.
        source: of each of k contacts, shape (k,).
        noise: variances of the differences of its distance and of its normal, shape (k, 2).
        recent: number of latest frames; as many are skipped between these and the earlier ones.
        earlier: number of earlier frames.
        comparison: output, shape (k, 6): the differences of each contact's four rows, and the inverse variances of
            distance and normal, 0 for a contact that has not touched throughout.

    Returns:
        The sum of the weighted squares.
    """
    h, misfit = history.shape[0], 0.0
    for i in range(source.shape[0]):
        s = source[i]
        for k in range(4):
            now, then = 0.0, 0.0
            for f in range(recent):
                now += history[h - recent + f, s, k]
            for f in range(earlier):
                then += history[h - 2 * recent - earlier + f, s, k]
            comparison[i, k] = now / recent - then / earlier
        for k in range(2):
            comparison[i, 4 + k] = 0.0 if np.isnan(comparison[i, 0]) else 1.0 / noise[i, k]
        for k in range(4):
            if comparison[i, 4] > 0.0:
                misfit += comparison[i, 4 if k == 0 else 5] * comparison[i, k] ** 2
    return misfit
