"""Detects slip by the forces on the fingertips.

A slip along a uniform surface moves no fingertip and rotates no normal. But forces reveal it: those of fingertips that
hold an object change slowly, and lie within their friction cones. When friction gives way, the load moves to other
fingers within some hundredths of a second, which does not happen while all hold. When the object slides as a whole, all
fingers reach the friction limit at once, at equal ratios of tangential to normal force, whatever the coefficient is.
When it turns about fingers that hold, others reach the limit: their ratios rise until they are equal and the largest,
and stay so while the load on the rest continues to grow. Being at the limit for long is no sign: fingers may have slid
there as they closed, and hold; the ratios must have risen. The largest ratio while the object is held is a lower bound
of an unknown coefficient: below it, nothing slides.
"""

from __future__ import annotations

import bisect
from typing import NamedTuple

import numpy as np

from tactopose_drake.core.evidence.contact_reading import ContactReading
from tactopose_drake.core.slip.slip_params import ForceTestParams
from tactopose_drake.core.times import TIME_ROUNDING, has_passed
from tactopose_drake.core.validation import FloatArray

BY_FORCES = "friction gives way, as the forces show"
"""The reason given for a slip that this test detects."""


class ForceTest(NamedTuple):
    """The state of the test.

    Attributes:
        times: of the latest h frames, oldest first, s.
        forces: of each source at these times, shape (h, s, 3), N; 0 for one that does not touch.
        ratios: of tangential to normal force, shape (h, s); NaN for sources without load.
        ratio: running estimate of the largest ratio while the object has been held.
        noise: running mean of the relative change of the forces.
        held_time: when a finger last touched anew, s.
        inside_time: when a finger was last within its friction cone, rather than at its limit, s.
    """

    times: tuple[float, ...] = ()
    forces: FloatArray = np.zeros((0, 0, 3))
    ratios: FloatArray = np.zeros((0, 0))
    ratio: float = 0.0
    noise: float = 0.0
    held_time: float = -np.inf
    inside_time: float = -np.inf

    def change_since(self, time: float) -> float:
        """The relative change of all forces since that time, s."""
        first = bisect.bisect_left(self.times, time)
        return float(_changes(self.forces[first : first + 1], self.forces[-1:])[0, 0])

    def sure_change(self, duration: float) -> float:
        """The relative change of all forces within this duration, s, robust to single bad readings.

        It is the least change between any of the last two frames and any of two before.
        """
        first = bisect.bisect_left(self.times, self.times[-2:][0] - duration)
        return float(_changes(self.forces[max(first - 1, 0) : first + 1], self.forces[-2:]).min())


def detect_by_forces(
    params: ForceTestParams, test: ForceTest, reading: ContactReading, time: float, *, has_joined: bool
) -> tuple[ForceTest, bool]:
    """Updates the test with a frame, and tells whether the object slips.

    Args:
        params: thresholds.
        test: after the last frame.
        reading: the contacts.
        time: of the frame, s.
        has_joined: whether a further finger has just touched.
    """
    test = ForceTest(held_time=time) if has_joined else test
    contacts = reading.evidence.contacts
    if contacts.f_PC is None or contacts.n_PC is None:
        return ForceTest(held_time=test.held_time), False
    kept = _with_forces(params, test, reading, time)
    ratios = kept.ratios[-1][np.isfinite(kept.ratios[-1])]
    if not has_passed(time, test.held_time, params.settling_time) or not len(ratios):
        return kept, False
    largest = min(float(ratios.max()), params.most_ratio)
    ratio = test.ratio + params.gain * max(largest - test.ratio, 0.0) if test.ratio > 0.0 else largest
    at_limit = ratios > params.limit_share * max(ratio, params.least_ratio)
    change = kept.sure_change(params.time)
    noise = test.noise + params.gain * (min(change, params.change) - test.noise)
    kept = kept._replace(ratio=ratio, noise=noise, inside_time=test.inside_time if at_limit.all() else time)
    are_enough = len(ratios) >= params.least_fingers
    are_alike = are_enough and np.ptp(ratios) < params.alike * ratios.mean()
    slides = are_alike and at_limit.all() and not has_passed(time, kept.inside_time, params.reaching_time)
    slides = slides and _have_risen(params, kept, time)
    gives_way = at_limit.any() and change > max(params.change, params.noises * test.noise)
    return kept, bool(slides or gives_way or (are_enough and _some_slide(params, kept, time)))


def _with_forces(params: ForceTestParams, test: ForceTest, reading: ContactReading, time: float) -> ForceTest:
    """Appends the forces of a frame, and drops old ones."""
    contacts = reading.evidence.contacts
    assert contacts.f_PC is not None
    assert contacts.n_PC is not None
    first, source = bisect.bisect_left(test.times, time - params.rise_time), reading.source[: len(contacts)]
    count, known = len(test.times) - first + 1, test.ratios.shape[1]
    forces, ratios = np.zeros((count, len(reading.sources), 3)), np.full((count, len(reading.sources)), np.nan)
    forces[:-1, :known], ratios[:-1, :known] = test.forces[first:], test.ratios[first:]
    forces[-1, source], ratios[-1, source] = contacts.f_PC, _ratios(params, contacts.f_PC, contacts.n_PC)
    return test._replace(times=(*test.times[first:], time), forces=forces, ratios=ratios)


def _changes(before: FloatArray, now: FloatArray) -> FloatArray:
    """Relative changes between all forces (a, s, 3) and (b, s, 3), over sources that touch in both, shape (a, b).

    A source that touches in one alone may be a lost reading.
    """
    before = before[:, None]
    both = before.any(axis=3) & now.any(axis=2)
    changed = np.sum((now - before) ** 2, axis=3).sum(axis=2, where=both)
    square = np.maximum(np.sum(before**2, axis=(2, 3)), np.sum(now**2, axis=(1, 2)))
    return np.asarray(np.sqrt(changed / np.maximum(square, 1e-12)))


def _have_risen(params: ForceTestParams, test: ForceTest, time: float) -> bool:
    """Whether the mean ratio has recently risen by more than alike ratios differ, which exceeds the noise."""
    begin = time - params.reaching_time - TIME_ROUNDING
    lately = test.ratios[bisect.bisect_left(test.times, begin) :, np.isfinite(test.ratios[-1])]
    means = lately[np.isfinite(lately).all(axis=1)].mean(axis=1)
    return bool(means[-1] > (1.0 + params.alike) * means.min())


def _some_slide(params: ForceTestParams, test: ForceTest, time: float) -> bool:
    """Whether at least two fingers have reached the friction limit, and stay there while the load continues to grow."""
    begin = time - params.plateau_time - TIME_ROUNDING
    if test.times[0] > begin or test.change_since(begin) < params.growth:
        return False
    now, lately = test.ratios[-1], test.ratios[bisect.bisect_left(test.times, begin) :]
    rise, swing = now - np.fmin.reduce(test.ratios), lately.max(axis=0) - lately.min(axis=0)
    slide = now[(rise > params.rise) & (swing < params.plateau) & (now > params.least_ratio)]
    limit = slide.max(initial=0.0)
    is_largest = np.fmax.reduce(now) <= (1.0 + params.equal) * limit
    return bool(is_largest and np.count_nonzero(slide > (1.0 - params.equal) * limit) > 1)


def _ratios(params: ForceTestParams, f_PC: FloatArray, n_PC: FloatArray) -> FloatArray:
    """Ratios of tangential to normal force of contacts (k, 3), shape (k,); NaN for those without load."""
    size = np.linalg.norm(f_PC, axis=1)
    along = np.abs(np.einsum("ki,ki->k", f_PC, n_PC))
    across = np.sqrt(np.maximum(size**2 - along**2, 0.0))
    bears = size > max(params.least_force, params.least_share * float(size.sum()))
    return np.where(bears, across / np.maximum(along, 1e-3 * size + 1e-12), np.nan)
