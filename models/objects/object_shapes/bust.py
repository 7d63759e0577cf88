"""A small bust of a curly-headed man who looks over his left shoulder, a cloth over the same shoulder.

Inside this file lengths are in mm. The head has a frame of its own: origin between the ears, x forward out of the
face, y to its left, z up.
"""

import numpy as np
import trimesh
from numpy.typing import NDArray

from .fields import capsule, disc, ellipsoid, length, smooth_cut, smooth_union, tube
from .sculpting import sculpt

Array = NDArray[np.float64]

HEAD_CENTER = np.array([3.0, 0.0, 105.0])
HEAD_TURN, HEAD_NOD, HEAD_TILT = np.deg2rad([20.0, 4.0, -6.0])  # about z, y, x


def _head_rotation() -> Array:
    cz, sz, cy, sy = np.cos(HEAD_TURN), np.sin(HEAD_TURN), np.cos(HEAD_NOD), np.sin(HEAD_NOD)
    cx, sx = np.cos(HEAD_TILT), np.sin(HEAD_TILT)
    about_z = np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]])
    about_y = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    about_x = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    return about_z @ about_y @ about_x


def _skull(p: Array) -> Array:
    shape = ellipsoid(p, (-4, 0, 9), (28, 22, 23))
    shape = smooth_union(shape, ellipsoid(p, (8, 0, -8), (18, 17, 25)), 8)
    shape = smooth_union(shape, ellipsoid(p, (20.5, 0, -27.5), (6, 7, 5)), 7)
    for side in (-1, 1):
        shape = smooth_union(shape, capsule(p, (0, 15 * side, -15), (17, 7 * side, -27), 5.5, 5), 6)
        shape = smooth_union(shape, ellipsoid(p, (14.5, 11.5 * side, -8), (8, 6, 9)), 8)
    return shape


def _face(p: Array, skull: Array) -> Array:
    shape = smooth_union(skull, ellipsoid(p, (18.0, 0, -18), (7, 9, 7.5)), 5)
    brow = [(20.0, -13, 5), (24.5, -7, 7.3), (25.3, 0, 6.3), (24.5, 7, 7.3), (20.0, 13, 5)]
    shape = smooth_union(shape, tube(p, brow, 2.5), 4)
    for side in (-1, 1):
        shape = smooth_cut(shape, ellipsoid(p, (27.5, 8.8 * side, 0.5), (6.0, 6.0, 4.4)), 4)
        shape = smooth_union(shape, ellipsoid(p, (19.0, 8.8 * side, 0.2), (5.2, 5.2, 4.4)), 1)
        lid = [(20.5, 4.8 * side, 0.6), (23.2, 7.6 * side, 2.6), (22.6, 10.4 * side, 2.6), (19.8, 13.0 * side, 0.6)]
        shape = smooth_union(shape, tube(p, lid, 1.3), 1.2)
    shape = smooth_union(shape, capsule(p, (24.5, 0, 6), (31.2, 0, -8.0), 2.2, 3.0), 3.5)
    shape = smooth_union(shape, ellipsoid(p, (25.5, 0, -8.5), (5, 3.6, 4)), 2)
    for side in (-1, 1):
        shape = smooth_union(shape, ellipsoid(p, (27.3, 3.8 * side, -9.4), (3.8, 2.4, 2.5)), 1.5)
    upper = [(22.3, -7, -18.4), (25.6, -2, -16.6), (25.9, 0, -17.0), (25.6, 2, -16.6), (22.3, 7, -18.4)]
    lower = [(22.3, -6.0, -19.8), (25.3, 0, -21.6), (22.3, 6.0, -19.8)]
    shape = smooth_union(shape, tube(p, upper, 2.0), 1.2)
    return smooth_union(shape, tube(p, lower, 2.1), 0.7)


def _ears(p: Array, head: Array) -> Array:
    for side in (-1, 1):
        ear = ellipsoid(p, (-3, 21.5 * side, -1.5), (5.6, 3.4, 8.6))
        ear = smooth_cut(ear, ellipsoid(p, (-2.2, 25.2 * side, -0.5), (3.2, 2.6, 5.2)), 1.2)
        root = ellipsoid(p, (-3, 17.5 * side, -2), (4.6, 4.5, 7.6))
        head = smooth_union(smooth_union(head, root, 3), ear, 2)
    return head


def _hair(p: Array, head: Array) -> Array:
    """Curls: balls spread over the skull by the golden angle, jittered, above and behind the hairline."""
    random = np.random.default_rng(7)
    count = 150
    height = 1 - (np.arange(count) + 0.5) * (2 / count)
    turn = np.arange(count) * (np.pi * (3 - np.sqrt(5)))
    spread = np.sqrt(1 - height**2)
    directions = np.stack([spread * np.cos(turn), spread * np.sin(turn), height], axis=1)
    centers = np.array([-4, 0, 9]) + directions * np.array([27.5, 22, 23.5]) + random.uniform(-1.2, 1.2, (count, 3))
    radii = random.uniform(4.2, 5.6, count)
    x, _, z = centers.T
    curls = np.inf
    for center, radius in zip(centers[z > 12 + 0.62 * x], radii[z > 12 + 0.62 * x], strict=True):
        if center[2] > -14:
            curls = smooth_union(curls, length(p - center) - radius, 2.2)
    return smooth_union(head, curls, 2.0)


def _torso(p: Array) -> Array:
    shape = ellipsoid(p, (1, 0, 38), (20, 35, 24))
    for side in (-1, 1):
        shape = smooth_union(shape, capsule(p, (-2, 8 * side, 58), (-2, 30 * side, 47), 9, 10), 8)
        shape = smooth_union(shape, ellipsoid(p, (11, 14 * side, 40), (10, 15, 11)), 6)
    # The sculptor's cuts: through the arms, and a curve below the chest.
    shape = -smooth_union(-shape, 36.5 - np.abs(p[..., 1]), 3)
    return smooth_cut(shape, ellipsoid(p, (0, 0, -4), (60, 62, 31)), 4)


def _neck(p: Array, body: Array, nape: Array, rotation: Array) -> Array:
    body = smooth_union(body, capsule(p, (-4, 0, 52), nape, 13, 12.5), 9)
    for side in (-1, 1):
        behind_ear = HEAD_CENTER + rotation @ np.array([-7, 15 * side, -10])
        body = smooth_union(body, capsule(p, behind_ear, (10, 4 * side, 58), 3.6, 2.6), 4)
        body = smooth_union(body, capsule(p, (11, 4 * side, 57), (3, 26 * side, 57), 2.2, 2.2), 4)
    return body


def _cloth(p: Array, body: Array) -> Array:
    """Folds of a cloth that lies over the left shoulder and runs around the body to the right hip."""
    path = np.array(
        [
            *[(10.0, -27.0, 27.0), (18.0, -15.0, 29.0), (21.0, 2.0, 37.0), (15.0, 16.0, 50.0), (2.0, 23.0, 58.0)],
            *[(-11.0, 19.0, 54.0), (-18.0, 5.0, 43.0), (-18.0, -12.0, 32.0), (-9.0, -27.0, 26.0)],
        ]
    )
    for lift, radius in ((0.0, 4.4), (0.55, 3.4), (1.0, 3.0)):
        fold = path + lift * np.array([0.0, 9.0, 4.0])
        body = smooth_union(body, tube(p, fold, radius), 3)
    return body


def _socle(p: Array) -> Array:
    plinth = disc(p, 24, 0, 9, 2.5)
    stem = disc(p, 12, 5, 34, 1)
    return -smooth_union(-smooth_union(plinth, stem, 12), p[..., 2], 1)


def _field(p: Array) -> Array:
    p = 1000 * p
    rotation = _head_rotation()
    in_head = (p - HEAD_CENTER) @ rotation
    head = _hair(in_head, _ears(in_head, _face(in_head, _skull(in_head))))
    body = _neck(p, _torso(p), HEAD_CENTER + rotation @ np.array([-6, 0, -14]), rotation)
    body = smooth_union(_cloth(p, body), _socle(p), 4)
    return smooth_union(body, head, 3) / 1000


def bust() -> trimesh.Trimesh:
    """A sculpted head-and-shoulders bust on a round socle, its head turned by 20 degrees."""
    return sculpt(_field, [[-0.038, -0.042, -0.003], [0.042, 0.042, 0.147]], 0.001, 1.1e-4, (0.0012, 0.005))
