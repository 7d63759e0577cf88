"""Batches of rigid poses and their six-parameter increments.

A batch of poses is an array X of shape (B, 3, 4), each item [R | p] (what `RigidTransform.GetAsMatrix34` returns).
An increment is a 6-vector (w, v), rotation first: R_PO = R_hat exp(w), p_PO = p_hat + v, so w is in the object's frame
O and v in the palm's frame P.

Sources: [B16] J. Bimbo, thesis, 2016, section 2.6.1; [S18] J. Sola et al., A micro Lie theory for state estimation,
2018.
"""

import numpy as np

from tactopose_drake.core.validation import FloatArray

RANDOM_ROTATION_VARIANCE = (np.pi**2 / 3.0 + 2.0) / 3.0
"""Mean square of each coordinate of the rotation vector of a uniformly random rotation, rad^2."""

ANY_POSE = np.repeat([3.0, 0.3], 3)
"""Standard deviations of the increments (w, v) of a pose in the hand of which nothing is known, rad and m."""
ANY_POSE.setflags(write=False)


def make_poses(R: FloatArray, p: FloatArray) -> FloatArray:
    """Combines rotations (..., 3, 3) and translations (..., 3) to poses (..., 3, 4)."""
    return np.concatenate([R, p[..., None]], axis=-1)


def identity_poses(count: int) -> FloatArray:
    """Identity poses, shape (count, 3, 4)."""
    return np.tile(np.eye(3, 4), (count, 1, 1))


def inverse(X_AB: FloatArray) -> FloatArray:
    """X_BA for poses (..., 3, 4)."""
    R_BA = np.swapaxes(X_AB[..., :3], -1, -2)
    return make_poses(R_BA, -np.einsum("...ij,...j->...i", R_BA, X_AB[..., 3]))


def compose(X_AB: FloatArray, X_BC: FloatArray) -> FloatArray:
    """X_AC = X_AB X_BC for poses (..., 3, 4), broadcast over the leading axes."""
    R_AB = X_AB[..., :3]
    p_AC = np.einsum("...ij,...j->...i", R_AB, X_BC[..., 3]) + X_AB[..., 3]
    return make_poses(R_AB @ X_BC[..., :3], p_AC)


def transform_points(X_AB: FloatArray, p_BQ: FloatArray) -> FloatArray:
    """Points in A: X_AB (..., 3, 4) applied to rows p_BQ (n, 3), shape (..., n, 3)."""
    p_AQ: FloatArray = p_BQ @ np.swapaxes(X_AB[..., :3], -1, -2) + X_AB[..., None, :, 3]
    return p_AQ


def skew(v: FloatArray) -> FloatArray:
    """The matrices [v]x with [v]x u = v x u, shape (..., 3, 3)."""
    out = np.zeros((*v.shape[:-1], 3, 3))
    x, y, z = v[..., 0], v[..., 1], v[..., 2]
    out[..., 0, 1], out[..., 0, 2], out[..., 1, 2] = -z, y, -x
    out[..., 1, 0], out[..., 2, 0], out[..., 2, 1] = z, -y, x
    return out


def point_jacobians(p: FloatArray) -> FloatArray:
    """The matrices [-[p]x 1] that map a twist (w, v) at the origin to velocities of points (k, 3), shape (k, 3, 6)."""
    out = np.zeros((len(p), 3, 6))
    out[:, :, :3] = -skew(p)
    out[:, [0, 1, 2], [3, 4, 5]] = 1.0
    return out


def axes_across(z: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Two unit vectors x and y, shape (..., 3) each, that make a right-handed frame with each of the unit vectors z."""
    x = np.cross(z, np.eye(3)[np.argmin(np.abs(z), axis=-1)])
    x /= np.linalg.norm(x, axis=-1, keepdims=True)
    return x, np.cross(z, x)


def exp_so3(w: FloatArray) -> FloatArray:
    """Rotation matrices exp([w]x), shape (..., 3, 3), from rotation vectors (..., 3), rad. [S18] eq. 69."""
    angle2 = np.sum(w * w, axis=-1)
    angle = np.sqrt(angle2)
    small = angle < 1e-4
    safe = np.where(small, 1.0, angle)
    a = np.where(small, 1.0 - angle2 / 6.0, np.sin(safe) / safe)
    b = np.where(small, 0.5 - angle2 / 24.0, (1.0 - np.cos(safe)) / safe**2)
    W = skew(w)
    R: FloatArray = np.eye(3) + a[..., None, None] * W + b[..., None, None] * (W @ W)
    return R


def right_jacobian(w: FloatArray) -> FloatArray:
    """The derivative of log(exp(w)^-1 exp(w + e)) by e at e = 0, shape (..., 3, 3), for (..., 3). [S18] eq. 143."""
    angle2 = np.sum(w * w, axis=-1)
    angle = np.sqrt(angle2)
    small = angle < 1e-3
    safe = np.where(small, 1.0, angle)
    a = np.where(small, 0.5 - angle2 / 24.0, (1.0 - np.cos(safe)) / safe**2)
    b = np.where(small, 1.0 / 6.0 - angle2 / 120.0, (safe - np.sin(safe)) / safe**3)
    W = skew(w)
    J: FloatArray = np.eye(3) - a[..., None, None] * W + b[..., None, None] * (W @ W)
    return J


def log_so3(R: FloatArray) -> FloatArray:
    """Rotation vectors (..., 3), rad, of angle at most pi, from rotation matrices (..., 3, 3)."""
    q = quaternion_from_matrix(R)
    sine = np.linalg.norm(q[..., 1:], axis=-1)
    angle = 2.0 * np.arctan2(sine, q[..., 0])
    scale = np.where(sine < 1e-9, 2.0, angle / np.where(sine < 1e-9, 1.0, sine))
    w: FloatArray = scale[..., None] * q[..., 1:]
    return w


def retract(X: FloatArray, increment: FloatArray) -> FloatArray:
    """Poses (..., 3, 4) moved by increments (..., 6): R exp(w), p + v."""
    return make_poses(X[..., :3] @ exp_so3(increment[..., :3]), X[..., 3] + increment[..., 3:])


def increments_between(X_from: FloatArray, X_to: FloatArray) -> FloatArray:
    """The increments (..., 6) with which `retract` takes X_from to X_to."""
    w = log_so3(np.swapaxes(X_from[..., :3], -1, -2) @ X_to[..., :3])
    return np.concatenate([w, X_to[..., 3] - X_from[..., 3]], axis=-1)


def increments_of_images(X_AB: FloatArray, X_image: FloatArray) -> FloatArray:
    """Jacobians (..., 6, 6) of the increments of symmetric images (..., 3, 4) by those of the poses themselves.

    For the image X_AB S with S = (E, s), an increment (w, v) of the pose becomes (E^T w, v - R_AB [s]x w). Covariances
    of increments must be transformed accordingly, as the image has other axes.
    """
    S = compose(inverse(X_AB), X_image)
    J = np.tile(np.eye(6), (*S.shape[:-2], 1, 1))
    J[..., :3, :3] = np.swapaxes(S[..., :3], -1, -2)
    J[..., 3:, :3] = -X_AB[..., :3] @ skew(S[..., 3])
    return J


def rotation_angles(R_A: FloatArray, R_B: FloatArray) -> FloatArray:
    """Angles between rotations (..., 3, 3), rad, in [0, pi]."""
    angles: FloatArray = np.linalg.norm(log_so3(np.swapaxes(R_A, -1, -2) @ R_B), axis=-1)
    return angles


def matrix_from_quaternion(q: FloatArray) -> FloatArray:
    """Rotation matrices (..., 3, 3) from quaternions wxyz (..., 4) of any non-zero length. [B16] eq. 2.19."""
    w, x, y, z = np.moveaxis(q / np.linalg.norm(q, axis=-1, keepdims=True), -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def quaternion_from_matrix(R: FloatArray) -> FloatArray:
    """Unit quaternions wxyz (..., 4), w >= 0, from rotation matrices (..., 3, 3).

    Each of four candidates divides by one component; the one with the largest component is the most accurate.
    """
    m = R
    xx, yy, zz = m[..., 0, 0], m[..., 1, 1], m[..., 2, 2]
    squares = np.stack([1 + xx + yy + zz, 1 + xx - yy - zz, 1 - xx + yy - zz, 1 - xx - yy + zz], axis=-1)
    wx, wy, wz = m[..., 2, 1] - m[..., 1, 2], m[..., 0, 2] - m[..., 2, 0], m[..., 1, 0] - m[..., 0, 1]
    xy, xz, yz = m[..., 1, 0] + m[..., 0, 1], m[..., 0, 2] + m[..., 2, 0], m[..., 2, 1] + m[..., 1, 2]
    products = np.stack(
        [
            np.stack([squares[..., 0], wx, wy, wz], axis=-1),
            np.stack([wx, squares[..., 1], xy, xz], axis=-1),
            np.stack([wy, xy, squares[..., 2], yz], axis=-1),
            np.stack([wz, xz, yz, squares[..., 3]], axis=-1),
        ],
        axis=-2,
    )
    best = np.argmax(squares, axis=-1)[..., None, None]
    q = np.take_along_axis(products, best, axis=-2)[..., 0, :]
    q = q / np.linalg.norm(q, axis=-1, keepdims=True)
    q_positive: FloatArray = np.where(q[..., :1] < 0, -q, q)
    return q_positive


def random_rotations(generator: np.random.Generator, count: int) -> FloatArray:
    """Rotation matrices, uniform over SO(3), shape (count, 3, 3)."""
    return matrix_from_quaternion(generator.normal(size=(count, 4)))
