"""Whether the object slips, by the forces on the fingertips.

A slip along a surface that is the same farther on moves no fingertip and turns no normal. Its forces tell: those of
fingertips that hold an object change slowly, and lie in their cones of friction. Where friction gives way, the load
goes over to other fingers within some hundredths of a second, which it does not do while all hold; and where the object
slides as a whole, all fingers come to the limit of friction at once, at equal ratios of tangential to normal force,
whatever the coefficient is. Where it turns about fingers that hold, others come there: their ratios rise until they are
equal, none is larger, and they stay so while the load that the rest bears goes on to grow. That fingers are at the
limit for long says nothing: they may have slid there as they closed, and hold; the ratios have to have risen. How far
they come while the object is held is a lower bound of the coefficient where that is not told: below, nothing slides.
"""

from __future__ import annotations

import bisect
from typing import NamedTuple

import numpy as np

from tactopose_drake.core.evidence.contact_reading import ContactReading
from tactopose_drake.core.slip.slip_params import ForceTestParams
from tactopose_drake.core.validation import FloatArray

BY_FORCES = "friction gives way, as the forces show"
"""What is said of a slip that is found so."""


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
        """By how much of the size of all forces those have changed since that time, s."""
        first = bisect.bisect_left(self.times, time)
        return float(_changes(self.forces[first : first + 1], self.forces[-1:])[0, 0])

    def sure_change(self, duration: float) -> float:
        """The same within so long, s, by no single reading, which may be far off.

        Of the last two frames and two of before the two count that differ least.
        """
        first = bisect.bisect_left(self.times, self.times[-2:][0] - duration)
        return float(_changes(self.forces[max(first - 1, 0) : first + 1], self.forces[-2:]).min())


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
    change = kept.sure_change(params.time)
    noise = test.noise + params.gain * (min(change, params.change) - test.noise)
    kept = kept._replace(ratio=ratio, noise=noise, inside_time=test.inside_time if at_limit.all() else time)
    are_enough = len(ratios) >= params.least_fingers
    are_alike = are_enough and np.ptp(ratios) < params.alike * ratios.mean()
    slides = are_alike and at_limit.all() and time < kept.inside_time + params.reaching_time
    slides = slides and _have_risen(params, kept, time)
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


def _changes(before: FloatArray, now: FloatArray) -> FloatArray:
    """By how much of the size of all forces (a, s, 3) and (b, s, 3) those differ that touch in both, shape (a, b).

    What touches in one alone may be a reading that was lost.
    """
    before = before[:, None]
    both = before.any(axis=3) & now.any(axis=2)
    changed = np.sum((now - before) ** 2, axis=3).sum(axis=2, where=both)
    square = np.maximum(np.sum(before**2, axis=(2, 3)), np.sum(now**2, axis=(1, 2)))
    return np.asarray(np.sqrt(changed / np.maximum(square, 1e-12)))


def _have_risen(params: ForceTestParams, test: ForceTest, time: float) -> bool:
    """Whether the ratios have lately risen, in the mean, by more than alike ones differ, which is more than noise."""
    lately = test.ratios[bisect.bisect_left(test.times, time - params.reaching_time) :, np.isfinite(test.ratios[-1])]
    means = lately[np.isfinite(lately).all(axis=1)].mean(axis=1)
    return bool(means[-1] > (1.0 + params.alike) * means.min())


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
