"""Detects slip by the motion of the object's surface under the fingertips.

Where the fingertips hold, an object that moves as they carry it keeps its surface at the contacts, up to noise. Errors
of the hand, of the pose and of the surface leave the same residuals from frame to frame. So differences of the
contacts' residuals over a short time depend on the slip alone: to first order they are J u, with u the unexplained
motion. It is a slip if u is significant against noise and the uncertainty of the fingertips' own motion, and not tiny.

A mode's pose is corrected at each frame, by touch, by vision and by searches, which changes its residuals. The history
therefore refers to a fixed pose, which moves as the fingertips say: new residuals are computed there for comparison,
and then the history is transferred to the present pose. The noise of single frames is estimated from frame-to-frame
changes of the residuals.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tactopose_drake.core.compilation import read_only
from tactopose_drake.core.evidence.contact_reading import ContactReading
from tactopose_drake.core.motion.rigid_motion import Motion, error_of_motion
from tactopose_drake.core.objectives.surface_contact import SurfaceContact
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.slip import slip_kernels
from tactopose_drake.core.slip.slip_params import SlipParams
from tactopose_drake.core.validation import FloatArray

BY_SURFACE = "the surface moves under the fingertips"
"""The reason given for a slip that this test detects."""

_NOISE = read_only(np.array([0.02, 4.0]))  # lower and upper bound on the estimated noise
_LEAST_VARIANCE = 1e-12
_ROWS = 4  # residuals of a contact: its distance, and the difference of normals
_KIND_OF_ROW = np.array([0, 1, 1, 1])  # index into variances of points and normals


class SlipTest(NamedTuple):
    """The state of the test.

    Attributes:
        residuals: of the latest h frames, oldest first, by source, whitened by the told errors and transferred to one
            pose, shape (h, s, 4); NaN for a source that does not touch.
        motions: covariances of the motions up to each of these frames, shape (h, 6, 6).
        noise: variances of what is new in distances and in normals at each frame.
        X_PO: that pose: the best mode's after the last frame, moved since, shape (3, 4); None before the first frame.
    """

    residuals: FloatArray = np.zeros((0, 0, _ROWS))
    motions: FloatArray = np.zeros((0, 6, 6))
    noise: tuple[float, float] = (1.0, 1.0)
    X_PO: FloatArray | None = None

    def moved(self, motion: Motion) -> SlipTest:
        """The state after a motion of the object."""
        return self if self.X_PO is None else self._replace(X_PO=motion.of_poses(self.X_PO))

    def restarted(self) -> SlipTest:
        """The state without its history."""
        return SlipTest(noise=self.noise, X_PO=self.X_PO)


class PoseChange(NamedTuple):
    """The best mode at a frame.

    Attributes:
        X_PO: its pose after the update, shape (3, 4).
        roughness: of the surface about each source: variances of positions, m^2, and of normals, rad^2, shape (s, 2).
        motion: since the last frame.
    """

    X_PO: FloatArray
    roughness: FloatArray
    motion: Motion


def detect_by_surface(
    model: ObjectModel, params: SlipParams, test: SlipTest, reading: ContactReading, change: PoseChange
) -> tuple[SlipTest, bool]:
    """Updates the test with a frame, and tells whether the object slips.

    Args:
        model: the object.
        params: thresholds.
        test: after the last frame, moved by the motion since.
        reading: the contacts.
        change: the best mode at this frame.
    """
    X_before = change.X_PO if test.X_PO is None else test.X_PO
    touch = SurfaceContact(model.grid, reading.contacts)
    residuals, jacobian = touch.rows_of_contacts(np.stack([X_before, change.X_PO]))
    noise, kept = np.array(test.noise), min(len(test.residuals) + 1, params.max_frames)
    history = np.empty((kept, len(reading.sources), _ROWS))
    rows = np.ascontiguousarray(residuals[..., :_ROWS])
    slip_kernels.follow_residuals(test.residuals, rows, reading.source, params.noise_gain, _NOISE, noise, history)
    motions = np.concatenate([test.motions, change.motion.covariance[None]])[-kept:]
    after = SlipTest(history, motions, (float(noise[0]), float(noise[1])), change.X_PO)
    return after, _has_slipped(params, after, jacobian[0, :, :_ROWS], reading, change)


def _has_slipped(
    params: SlipParams, test: SlipTest, jacobian: FloatArray, reading: ContactReading, change: PoseChange
) -> bool:
    """Whether the latest residuals differ from earlier ones by a slip; the Jacobian is (k, 4, 6)."""
    history, noise = test.residuals, np.array(test.noise)
    rough = params.rough_share * np.maximum(change.roughness[reading.source], 0.0) / reading.parts.told
    tests = (params.few_frames, params.few_threshold), (params.many_frames, params.many_threshold)
    for recent, threshold in tests:
        earlier = min(len(history) - 2 * recent, params.compared_frames)
        if earlier < params.least_frames:
            continue
        variances = np.maximum(noise * (1.0 / recent + 1.0 / earlier) + rough, _LEAST_VARIANCE)
        found = np.empty((len(rough), _ROWS + 2))
        misfit = slip_kernels.compare_frames(history, reading.source, variances, recent, earlier, found)
        if misfit <= threshold:  # A motion cannot explain more than the whole misfit.
            continue
        known = found[:, _ROWS] > 0.0
        J, differences = jacobian[known].reshape(-1, 6), found[known, :_ROWS].reshape(-1)
        weights = found[known][:, _ROWS + _KIND_OF_ROW].reshape(-1)
        moved = Motion(np.zeros(6), params.motion_share * _between(test.motions, recent, earlier))
        explained, u = _explain(J, weights, differences, error_of_motion(change.X_PO[None], moved)[0])
        if explained > threshold and _way(reading.contacts.p_PC, change.X_PO, u) > params.least_distance:
            return True
    return False


def _between(motions: FloatArray, recent: int, earlier: int) -> FloatArray:
    """Covariance (6, 6) of the motion between the means of the compared frames, from those up to each (h, 6, 6).

    A motion affects all frames from its own on: a share of the earlier frames' mean, all of it for motions in between,
    and a share of the recent frames' mean. Its covariance counts by this share, which is more than the share's square,
    as of independent errors: those of successive motions are alike.
    """
    share = [*np.arange(earlier) / earlier, *np.ones(recent), *1.0 - np.arange(recent) / recent]
    covariance: FloatArray = np.tensordot(share, motions[-len(share) :], 1)
    return covariance


def _way(p_PC: FloatArray, X_PO: FloatArray, u: FloatArray) -> float:
    """Root mean square displacement of the contacts on the object by an increment (6,) of the pose, m."""
    arms = (p_PC - X_PO[:, 3]) @ X_PO[:, :3]
    moved = np.cross(u[:3], arms) @ X_PO[:, :3].T + u[3:]
    return float(np.sqrt(np.mean(np.sum(moved**2, axis=1))))


def _explain(J: FloatArray, weight: FloatArray, difference: FloatArray, error: FloatArray) -> tuple[float, FloatArray]:
    """How much of differences (m,) a motion explains, and the best motion as an increment (6,) of the pose.

    Without a slip g = J^T W d has the covariance A + A E A, with A = J^T W J and E that of the motion's error; then
    g^T (A + A E A)^-1 g is chi-square with at most six degrees of freedom.
    """
    JW = J.T * weight
    A, g = JW @ J, JW @ difference
    return float(g @ _solve(A + A @ error @ A, g, 1e-6)), _solve(A, g, 1e-4)


def _solve(A: FloatArray, g: FloatArray, held: float) -> FloatArray:
    """A^-1 g for a matrix (6, 6), regularised by a share of its diagonal."""
    scale = 1.0 / np.sqrt(np.diag(A) + 1e-12)
    u: FloatArray = np.linalg.solve(A * np.outer(scale, scale) + held * np.eye(6), g * scale) * scale
    return u
