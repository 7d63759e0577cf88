"""Whether the object slips: by how it moves under the fingertips, how these move, and the forces on them.

Where the fingertips hold, an object that moves as they carry it has its surface where they touch at all times, up to
their noise. What errors of the hand, of the pose and of the surface leave between surface and contact is the same from
frame to frame. So the differences of contacts' residuals over a short time tell of the slip alone: to first order they
are J u, where u is the motion that nothing explains. It is a slip where the touch tells u apart from noise, and from
what is unknown of the fingertips' own motion, and it is more than a little.

A mode's pose is corrected at each frame, by touch, by vision and by searches, and what it leaves over changes by that.
The history is therefore kept with the pose that it is of, which moves as the fingertips say: what contacts leave over
there is compared with it, and then it is taken to the pose of now. How large the noise of single frames is shows in how
residuals change from one to the next.

Of a fingertip that rolls on the object or sticks to it, the point that touches has the object's velocity v + w x p. Of
k fingertips these are 3 k equations of six unknowns, the closure of the loops that hand and object make. What no twist
explains of their displacements within a short time is the innovation: while all hold, it is the noise of the measured
velocities, which shows in how it changes from one frame to the next, and a share of the way that the fingertips went,
by which kinematics err. Its normalised square is chi-square with 3 k - 6 degrees of freedom, until one slides.

A slip along a surface that is the same farther on moves no fingertip and turns no normal. Its forces tell: those of
fingertips that hold an object change slowly, and lie in their cones of friction. Where friction gives way, the load
goes over to other fingers within some hundredths of a second, which it does not do while all hold; and where the object
slides as a whole, all fingers come to the limit of friction at once, at equal ratios of tangential to normal force,
whatever the coefficient is. Where it turns about fingers that hold, others come there: their ratios rise until they are
equal, none is larger, and they stay so while the load that the rest bears goes on to grow. That fingers are at the
limit for long says nothing: they may have slid there as they closed, and hold. How far the ratios come while the object
is held is a lower bound of the coefficient where that is not told: below, nothing slides.
"""

from __future__ import annotations

import bisect
import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from tactopose_drake.core.compilation import read_only
from tactopose_drake.core.kernels import slip_kernels
from tactopose_drake.core.objectives.surface_contact import SurfaceContact
from tactopose_drake.core.posterior.chi_square import chi_square_limit
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.tracking.frame import ContactReading
from tactopose_drake.core.tracking.motion_prediction import Motion, error_of_motion
from tactopose_drake.core.tracking.tracker_params import ForceTestParams, RigidityTestParams, SlipParams
from tactopose_drake.core.validation import FloatArray

_NOISE = read_only(np.array([0.02, 4.0]))  # the least and the most that is taken for it
_LEAST_VARIANCE = 1e-12
_LEAST_CONTACTS = 3  # of two, the distance alone is told
_MOST_GROWTH = 4.0  # of the noise by one frame
_ROWS = 4  # of a contact: its distance, and the difference of the normals
_KIND_OF_ROW = np.array([0, 1, 1, 1])  # by which variances are told, of points or of normals


class SlipTest(NamedTuple):
    """What the test remembers.

    Attributes:
        residuals: of the latest h frames, oldest first, whitened by what is told of the contacts' errors, by source, as
            they would be at one pose, shape (h, s, 4); NaN where a source does not touch.
        noise: variances of what is new of distances and of normals at each frame.
        X_PO: that pose, which the best mode had after the last of them, as it has moved since, shape (3, 4); None
            before the first.
    """

    residuals: FloatArray = np.zeros((0, 0, _ROWS))
    noise: tuple[float, float] = (1.0, 1.0)
    X_PO: FloatArray | None = None

    def moved(self, motion: Motion) -> SlipTest:
        """The same after a motion of the object."""
        return self if self.X_PO is None else self._replace(X_PO=motion.of_poses(self.X_PO))

    def restarted(self) -> SlipTest:
        """Without the history."""
        return self._replace(residuals=np.zeros((0, 0, _ROWS)))


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


def detect_slip(
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
    slips = _has_slipped(params, history, jacobian[0, :, :_ROWS], noise, reading, change)
    return SlipTest(history, (float(noise[0]), float(noise[1])), change.X_PO), slips


def _has_slipped(
    params: SlipParams,
    history: FloatArray,
    jacobian: FloatArray,
    noise: FloatArray,
    reading: ContactReading,
    change: PoseChange,
) -> bool:
    """Whether the latest of the residuals (h, s, 4) differ from those before by a slip; the jacobian is (k, 4, 6)."""
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
        error = params.motion_share * error_of_motion(change.X_PO[None], change.motion)[0]
        explained, u = _explain(J, weights, differences, (1.5 * recent + 0.5 * earlier) * error)
        if explained > threshold and _way(reading.contacts.p_PC, change.X_PO, u) > params.least_distance:
            return True
    return False


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


class RigidityTest(NamedTuple):
    """What the test remembers.

    Attributes:
        times: of the latest frames, oldest first, s.
        displacements: in each of them, of the fingertips where they touch, by source, shape (h, s, 3), m; NaN where one
            does not touch, or has just come to touch: on its way there nothing bound it.
        touching: names of the sources that touched in the last of them.
        noise: variance of the velocities' errors, of each coordinate, m^2/s^2; None before the first frame.
    """

    times: tuple[float, ...] = ()
    displacements: FloatArray = np.zeros((0, 0, 3))
    touching: frozenset[str] = frozenset()
    noise: float | None = None


def detect_by_motion(
    params: RigidityTestParams,
    test: RigidityTest,
    reading: ContactReading,
    tip_velocity: Mapping[str, FloatArray] | None,
    time: float,
    duration: float,
) -> tuple[RigidityTest, bool]:
    """The test after a frame, and whether a fingertip slides.

    Args:
        params: when one does.
        test: after the last frame.
        reading: the contacts.
        tip_velocity: spatial velocities [w, v] of the fingertips at the origin of P, by source, rad/s and m/s.
        time: of the frame, s.
        duration: since the last frame, s.
    """
    if tip_velocity is None or duration <= 0.0:
        return RigidityTest(noise=test.noise), False
    names, noise = reading.sources, params.velocity_noise**2 if test.noise is None else test.noise
    touching = frozenset(frame_names := [names[s] for s in reading.source])
    stay = [row for row, name in enumerate(frame_names) if name in test.touching and name in tip_velocity]
    velocity = np.array([tip_velocity[frame_names[row]] for row in stay]).reshape(-1, 6)
    first = sum(then <= time - params.time + 1e-9 for then in test.times)
    before, squares = test.displacements[first:], np.empty(3)
    displacements = np.full((len(before) + 1, len(names), 3), np.nan)
    displacements[:-1, : before.shape[1]] = before
    p_PC, source = reading.contacts.p_PC[stay], reading.source[stay]
    steady = slip_kernels.add_displacements(source, p_PC, velocity, duration, displacements, squares)
    test = RigidityTest((*test.times[first:], time), displacements, touching, noise)
    if steady < _LEAST_CONTACTS:
        return test, False
    unexplained, of_change, of_ways = squares.tolist()
    freedom = 3 * steady - 6
    if len(before):
        # Of two independent errors the difference has twice the variance of one. A slide goes on as before.
        seen = 0.5 * of_change / (freedom * duration**2)
        seen = min(max(seen, params.least_velocity_noise**2), _MOST_GROWTH * noise)
        test = test._replace(noise=noise + params.noise_gain * (seen - noise))
    # Noise adds up as a random walk, what kinematics err along the way does not average out.
    variance = noise * duration**2 * len(displacements) + params.way_share**2 * of_ways / (3 * steady)
    is_news = unexplained > variance * chi_square_limit(freedom, params.false_alarm_probability)
    return test, bool(is_news and unexplained > steady * params.least_distance**2)


class ForceTest(NamedTuple):
    """What the test remembers.

    Attributes:
        times: of the latest h frames, oldest first, s.
        forces: of each source then, shape (h, s, 3), N; 0 where one does not touch.
        ratios: of tangential to normal force, likewise, shape (h, s); NaN where one bears no load.
        ratio: the largest of them since the object is held, but for the last moments.
        noise: by how much of their size forces change in the mean.
        held_time: since when no finger came to touch anew, s.
        inside_time: when a finger was last within its cone of friction, rather than at its limit, s.
    """

    times: tuple[float, ...] = ()
    forces: FloatArray = np.zeros((0, 0, 3))
    ratios: FloatArray = np.zeros((0, 0))
    ratio: float = 0.0
    noise: float = 0.0
    held_time: float = -np.inf
    inside_time: float = -np.inf

    def change_since(self, time: float) -> float:
        """By how much of their size forces have changed since that time, s."""
        before, now = self.forces[bisect.bisect_left(self.times, time)], self.forces[-1]
        square = max(float(np.sum(before**2)), float(np.sum(now**2)), 1e-12)
        return math.sqrt(float(np.sum((now - before) ** 2)) / square)


def detect_by_forces(
    params: ForceTestParams, test: ForceTest, reading: ContactReading, time: float, *, is_new: bool
) -> tuple[ForceTest, bool]:
    """The test after a frame, and whether the object slips.

    Args:
        params: when it does.
        test: after the last frame.
        reading: the contacts.
        time: of the frame, s.
        is_new: whether a finger has just come to touch.
    """
    test = ForceTest(held_time=time) if is_new else test
    contacts = reading.evidence.contacts
    if contacts.f_PC is None or contacts.n_PC is None:
        return ForceTest(held_time=test.held_time), False
    kept = _with_forces(params, test, reading, time)
    ratios = kept.ratios[-1][np.isfinite(kept.ratios[-1])]
    if time < test.held_time + params.settling_time or not len(ratios):
        return kept, False
    largest = min(float(ratios.max()), params.most_ratio)
    ratio = test.ratio + params.gain * max(largest - test.ratio, 0.0) if test.ratio > 0.0 else largest
    at_limit = ratios > params.limit_share * max(ratio, params.least_ratio)
    change = kept.change_since(time - params.time)
    noise = test.noise + params.gain * (min(change, params.change) - test.noise)
    kept = kept._replace(ratio=ratio, noise=noise, inside_time=test.inside_time if at_limit.all() else time)
    are_enough = len(ratios) >= params.least_fingers
    are_alike = are_enough and np.ptp(ratios) < params.alike * ratios.mean()
    slides = are_alike and at_limit.all() and time < kept.inside_time + params.reaching_time
    gives_way = at_limit.any() and change > max(params.change, params.noises * test.noise)
    return kept, bool(slides or gives_way or (are_enough and _some_slide(params, kept, time)))


def _with_forces(params: ForceTestParams, test: ForceTest, reading: ContactReading, time: float) -> ForceTest:
    """The test with the forces of a frame, and without what is long ago."""
    contacts = reading.evidence.contacts
    assert contacts.f_PC is not None
    assert contacts.n_PC is not None
    first, source = bisect.bisect_left(test.times, time - params.rise_time), reading.source[: len(contacts)]
    count, known = len(test.times) - first + 1, test.ratios.shape[1]
    forces, ratios = np.zeros((count, len(reading.sources), 3)), np.full((count, len(reading.sources)), np.nan)
    forces[:-1, :known], ratios[:-1, :known] = test.forces[first:], test.ratios[first:]
    forces[-1, source], ratios[-1, source] = contacts.f_PC, _ratios(params, contacts.f_PC, contacts.n_PC)
    return test._replace(times=(*test.times[first:], time), forces=forces, ratios=ratios)


def _some_slide(params: ForceTestParams, test: ForceTest, time: float) -> bool:
    """Whether two fingers or more have come to the limit of friction, and stay there while the load goes on to grow."""
    begin = time - params.plateau_time - 1e-9
    if test.times[0] > begin or test.change_since(begin) < params.growth:
        return False
    now, lately = test.ratios[-1], test.ratios[bisect.bisect_left(test.times, begin) :]
    rise, swing = now - np.fmin.reduce(test.ratios), lately.max(axis=0) - lately.min(axis=0)
    slide = now[(rise > params.rise) & (swing < params.plateau) & (now > params.least_ratio)]
    limit = slide.max(initial=0.0)
    is_largest = np.fmax.reduce(now) <= (1.0 + params.equal) * limit
    return bool(is_largest and np.count_nonzero(slide > (1.0 - params.equal) * limit) > 1)


def _ratios(params: ForceTestParams, f_PC: FloatArray, n_PC: FloatArray) -> FloatArray:
    """Of tangential to normal force, of contacts (k, 3), shape (k,); NaN of those that bear no load."""
    size = np.linalg.norm(f_PC, axis=1)
    along = np.abs(np.einsum("ki,ki->k", f_PC, n_PC))
    across = np.sqrt(np.maximum(size**2 - along**2, 0.0))
    bears = size > max(params.least_force, params.least_share * float(size.sum()))
    return np.where(bears, across / np.maximum(along, 1e-3 * size + 1e-12), np.nan)
