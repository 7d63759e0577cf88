"""Whether the object slips, by how its surface moves under the fingertips.

Where the fingertips hold, an object that moves as they carry it has its surface where they touch at all times, up to
their noise. What errors of the hand, of the pose and of the surface leave between surface and contact is the same from
frame to frame. So the differences of contacts' residuals over a short time tell of the slip alone: to first order they
are J u, where u is the motion that nothing explains. It is a slip where the touch tells u apart from noise, and from
what is unknown of the fingertips' own motion, and it is more than a little.

A mode's pose is corrected at each frame, by touch, by vision and by searches, and what it leaves over changes by that.
The history is therefore kept with the pose that it is of, which moves as the fingertips say: what contacts leave over
there is compared with it, and then it is taken to the pose of now. How large the noise of single frames is shows in how
residuals change from one to the next.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tactopose_drake.core.compilation import read_only
from tactopose_drake.core.evidence.contact_reading import ContactReading
from tactopose_drake.core.kernels import slip_kernels
from tactopose_drake.core.motion.rigid_motion import Motion, error_of_motion
from tactopose_drake.core.objectives.surface_contact import SurfaceContact
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.slip.slip_params import SlipParams
from tactopose_drake.core.validation import FloatArray

BY_SURFACE = "the surface moves under the fingertips"
"""What is said of a slip that is found so."""

_NOISE = read_only(np.array([0.02, 4.0]))  # the least and the most that is taken for it
_LEAST_VARIANCE = 1e-12
_ROWS = 4  # of a contact: its distance, and the difference of the normals
_KIND_OF_ROW = np.array([0, 1, 1, 1])  # by which variances are told, of points or of normals


class SlipTest(NamedTuple):
    """What the test remembers.

    Attributes:
        residuals: of the latest h frames, oldest first, whitened by what is told of the contacts' errors, by source, as
            they would be at one pose, shape (h, s, 4); NaN where a source does not touch.
        motions: covariances of the motions up to each of these frames, shape (h, 6, 6).
        noise: variances of what is new of distances and of normals at each frame.
        X_PO: that pose, which the best mode had after the last of them, as it has moved since, shape (3, 4); None
            before the first.
    """

    residuals: FloatArray = np.zeros((0, 0, _ROWS))
    motions: FloatArray = np.zeros((0, 6, 6))
    noise: tuple[float, float] = (1.0, 1.0)
    X_PO: FloatArray | None = None

    def moved(self, motion: Motion) -> SlipTest:
        """The same after a motion of the object."""
        return self if self.X_PO is None else self._replace(X_PO=motion.of_poses(self.X_PO))

    def restarted(self) -> SlipTest:
        """Without the history."""
        return SlipTest(noise=self.noise, X_PO=self.X_PO)


class PoseChange(NamedTuple):
    """The best mode at a frame.

    Attributes:
        X_PO: its pose after the touch, shape (3, 4).
        roughness: of the surface about each source: variances of positions, m^2, and of normals, rad^2, shape (s, 2).
        motion: since the last frame.
    """

    X_PO: FloatArray
    roughness: FloatArray
    motion: Motion


def detect_by_surface(
    model: ObjectModel, params: SlipParams, test: SlipTest, reading: ContactReading, change: PoseChange
) -> tuple[SlipTest, bool]:
    """The test after a frame, and whether the object slips.

    Args:
        model: the object.
        params: when it does.
        test: after the last frame, moved by the motion since.
        reading: the contacts.
        change: of the best mode, by the frame.
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
    """Whether the latest of the residuals differ from those before by a slip; the jacobian is (k, 4, 6)."""
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
        if misfit <= threshold:  # A motion explains a part of it at most.
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
    """Covariance (6, 6) of the motion between the means of frames that are compared, from those up to each (h, 6, 6).

    What a motion moves it moves in all frames from its own on: of the earlier ones in some, of the recent ones in all,
    or in some, and in all of those that are left out between. Errors of motions are taken for alike, not independent.
    """
    share = [*np.arange(earlier) / earlier, *np.ones(recent), *1.0 - np.arange(recent) / recent]
    covariance: FloatArray = np.tensordot(share, motions[-len(share) :], 1)
    return covariance


def _way(p_PC: FloatArray, X_PO: FloatArray, u: FloatArray) -> float:
    """How far an increment of the pose moves the object where it is touched, root mean square, m."""
    arms = (p_PC - X_PO[:, 3]) @ X_PO[:, :3]
    moved = np.cross(u[:3], arms) @ X_PO[:, :3].T + u[3:]
    return float(np.sqrt(np.mean(np.sum(moved**2, axis=1))))


def _explain(J: FloatArray, weight: FloatArray, difference: FloatArray, error: FloatArray) -> tuple[float, FloatArray]:
    """How much a motion explains of differences (m,), and the one that does best, as an increment (6,) of the pose.

    Without a slip g = J^T W d has the covariance A + A E A, with A = J^T W J and E that of the motion's error; then
    g^T (A + A E A)^-1 g is chi-square with six degrees of freedom at most.
    """
    JW = J.T * weight
    A, g = JW @ J, JW @ difference
    return float(g @ _solve(A + A @ error @ A, g, 1e-6)), _solve(A, g, 1e-4)


def _solve(A: FloatArray, g: FloatArray, held: float) -> FloatArray:
    """A^-1 g of a matrix (6, 6) that is held by so much of its diagonal."""
    scale = 1.0 / np.sqrt(np.diag(A) + 1e-12)
    u: FloatArray = np.linalg.solve(A * np.outer(scale, scale) + held * np.eye(6), g * scale) * scale
    return u
