"""What fingertips and contacts leave unexplained over the latest frames, compiled.

See `rigidity_test.py` and `slip_detection.py`.
"""

from typing import NamedTuple

import numpy as np

from tactopose_drake.core.compilation import (
    Floats1,
    Floats2,
    Floats3,
    Longs1,
    OutFloats1,
    OutFloats2,
    OutFloats3,
    OutLongs1,
    kernel,
    part,
)
from tactopose_drake.core.kernels.matrix_kernels import cholesky, solve

LEAST_VARIANCE = 1e-12


@kernel
def follow_displacements(
    before: Floats3,
    source: Longs1,
    p: Floats2,
    velocity: Floats2,
    duration: float,
    after: OutFloats3,
    squares: OutFloats1,
) -> int:
    """How many of the k fingertips that touch have touched in all frames, and what their ways come to.

    Args:
        before: displacements in h earlier frames, by source, shape (h, s', 3); NaN where a source did not touch.
        source: of each fingertip that touches now, shape (k,).
        p: where it does, shape (k, 3), m.
        velocity: its spatial velocity [w, v], shape (k, 6).
        duration: of the frame, s.
        after: the same with the displacements in this frame, written, shape (h + 1, s, 3).
        squares: written, sums over these fingertips: of what no small rigid motion explains of their ways in all
            frames, and of the change from the last frame to this one, and of the ways, shape (3,), m^2.
    """
    h, k = before.shape[0], p.shape[0]
    for f in range(h + 1):
        for s in range(after.shape[1]):
            for a in range(3):
                after[f, s, a] = before[f, s, a] if f < h and s < before.shape[1] else np.nan
    arms, ways, changes = np.empty((k, 3)), np.zeros((k, 3)), np.zeros((k, 3))
    steady = 0
    for i in range(k):
        s, has_touched = source[i], True
        w0, w1, w2 = velocity[i, 0], velocity[i, 1], velocity[i, 2]
        after[h, s, 0] = duration * (w1 * p[i, 2] - w2 * p[i, 1] + velocity[i, 3])
        after[h, s, 1] = duration * (w2 * p[i, 0] - w0 * p[i, 2] + velocity[i, 4])
        after[h, s, 2] = duration * (w0 * p[i, 1] - w1 * p[i, 0] + velocity[i, 5])
        for f in range(h):
            has_touched = has_touched and not np.isnan(after[f, s, 0])
        if has_touched:
            for a in range(3):
                arms[steady, a] = p[i, a]
                for f in range(h + 1):
                    ways[steady, a] += after[f, s, a]
                if h > 0:
                    changes[steady, a] = after[h, s, a] - after[h - 1, s, a]
            steady += 1
    squares[2] = 0.0
    for i in range(steady):
        for a in range(3):
            squares[2] += ways[i, a] ** 2
    _take_mean(arms, steady)
    squares[0], squares[1] = _unexplained(arms, ways, steady), _unexplained(arms, changes, steady)
    return steady


@part
def _take_mean(rows: OutFloats2, count: int) -> None:
    """Takes their mean from the first rows (count, 3)."""
    for a in range(3):
        mean = 0.0
        for i in range(count):
            mean += rows[i, a] / count
        for i in range(count):
            rows[i, a] -= mean


@part
def _unexplained(arms: Floats2, ways: OutFloats2, count: int) -> float:
    """The square of what no small rigid motion explains of ways (count, 3) of points with arms from their mean.

    The translation is the ways' mean, which is taken from them, and the rotation is that of least squares.
    """
    _take_mean(ways, count)
    inertia, L, turn = np.zeros((3, 3)), np.empty((3, 3)), np.zeros(3)
    for i in range(count):
        for a in range(3):
            c, d = (a + 1) % 3, (a + 2) % 3
            turn[a] += arms[i, c] * ways[i, d] - arms[i, d] * ways[i, c]
            inertia[a, a] += arms[i, c] ** 2 + arms[i, d] ** 2
            for e in range(a):
                inertia[a, e] -= arms[i, a] * arms[i, e]
    # Of points on a line a turn about it moves none.
    held = 1e-9 * (inertia[0, 0] + inertia[1, 1] + inertia[2, 2]) + 1e-30
    for a in range(3):
        inertia[a, a] += held
    cholesky(inertia, L)
    solve(L, turn)
    square = 0.0
    for i in range(count):
        for a in range(3):
            c, d = (a + 1) % 3, (a + 2) % 3
            square += (ways[i, a] - (turn[c] * arms[i, d] - turn[d] * arms[i, c])) ** 2
    return square


class SlipRule(NamedTuple):
    """Numbers of `SlipParams`, which says what they are for.

    Attributes:
        compared_frames, least_frames: those before the latest ones, at the most and at the least.
        noise_gain: by which the noise follows that of each frame,
        least_noise, most_noise: which counts for no less and for no more.
    """

    compared_frames: int
    least_frames: int
    noise_gain: float
    least_noise: float
    most_noise: float


class Comparison(NamedTuple):
    """Of means of the latest frames' residuals with those of earlier ones, over t spans of as many frames.

    Attributes:
        recent: how many frames each span has, shape (t,).
        earlier: written, how many there are to compare with; 0 where they are too few, shape (t,).
        difference: written, of each of k contacts, shape (t, k, 4).
        weight: written, one over the variances of its distance and of its normal; 0 of one that has not touched all
            along, shape (t, k, 2).
        misfit: written, sums of the weighted squares, shape (t,).
    """

    recent: Longs1
    earlier: OutLongs1
    difference: OutFloats3
    weight: OutFloats3
    misfit: OutFloats1


@kernel
def follow_residuals(
    before: Floats3,
    residuals: Floats3,
    source: Longs1,
    rough: Floats2,
    rule: SlipRule,
    noise: OutFloats1,
    after: OutFloats3,
    comparison: Comparison,
) -> None:
    """The history of residuals with those of now, and how these differ from earlier ones.

    Args:
        before: residuals of the latest h frames, by source, shape (h, s', 4); NaN where one did not touch.
        residuals: of k contacts now, at the pose that these are of and at another, shape (2, k, 4).
        source: of each of them, shape (k,).
        rough: variances of distances and of normals that the surface adds, shape (k, 2).
        rule: `SlipRule`.
        noise: variances of what is new of distances and of normals at each frame, which follow it, shape (2,).
        after: the latest frames with that of now, as they would be at the other pose, written, shape (h', s, 4).
        comparison: `Comparison`.
    """
    h, kept, count = before.shape[0], after.shape[0], source.shape[0]
    for f in range(kept):
        for s in range(after.shape[1]):
            for k in range(4):
                after[f, s, k] = np.nan
    again, of_points, of_normals = 0, 0.0, 0.0
    for i in range(count):
        s = source[i]
        is_known = s < before.shape[1]
        if h > 0 and is_known and not np.isnan(before[h - 1, s, 0]):
            again += 1
            of_points += (residuals[0, i, 0] - before[h - 1, s, 0]) ** 2
            for k in range(1, 4):
                of_normals += (residuals[0, i, k] - before[h - 1, s, k]) ** 2
        for k in range(4):
            shift = residuals[1, i, k] - residuals[0, i, k]
            after[kept - 1, s, k] = residuals[1, i, k]
            for f in range(kept - 1):
                if is_known:
                    after[f, s, k] = before[h - kept + 1 + f, s, k] + shift
    if again > 0:
        # Half the squares is expected; a normal's error is across it: of its three rows two vary.
        noise[0] += rule.noise_gain * (_between(rule, 0.5 * of_points / again) - noise[0])
        noise[1] += rule.noise_gain * (_between(rule, 0.25 * of_normals / again) - noise[1])
    for t in range(comparison.recent.shape[0]):
        _compare(t, after, source, rough, rule, noise, comparison)


@part
def _between(rule: SlipRule, noise: float) -> float:
    return min(max(noise, rule.least_noise), rule.most_noise)


@part
def _compare(
    t: int, history: Floats3, source: Longs1, rough: Floats2, rule: SlipRule, noise: Floats1, comparison: Comparison
) -> None:
    """The span t of the comparison, by the residuals (h, s, 4)."""
    h, recent = history.shape[0], comparison.recent[t]
    end = max(h - 2 * recent, 0)
    earlier = min(end, rule.compared_frames)
    comparison.earlier[t], comparison.misfit[t] = earlier if earlier >= rule.least_frames else 0, 0.0
    if comparison.earlier[t] == 0:
        return
    of_means = 1.0 / recent + 1.0 / earlier
    for i in range(source.shape[0]):
        s = source[i]
        for k in range(4):
            now, then = 0.0, 0.0
            for f in range(h - recent, h):
                now += history[f, s, k]
            for f in range(end - earlier, end):
                then += history[f, s, k]
            comparison.difference[t, i, k] = now / recent - then / earlier
        is_known = not np.isnan(comparison.difference[t, i, 0])
        for k in range(2):
            variance = max(noise[k] * of_means + rough[i, k], LEAST_VARIANCE)
            comparison.weight[t, i, k] = 1.0 / variance if is_known else 0.0
        for k in range(4):
            if is_known:
                comparison.misfit[t] += comparison.weight[t, i, min(k, 1)] * comparison.difference[t, i, k] ** 2
