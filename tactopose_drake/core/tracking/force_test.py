"""Whether forces say that the object slips: those of fingertips that hold it change slowly, and lie in their cones.

What slides along a surface that is the same farther on moves no fingertip and turns no normal. Its forces tell. Where
friction gives way, the load goes over to other fingers within some hundredths of a second, which it does not do while
all hold; and where the object slides as a whole, all fingers come to the limit of friction at once, at equal ratios of
tangential to normal force, whatever the coefficient is. That fingers are at the limit for long says nothing: they may
have slid there as they closed, and hold. How far the ratios come while the object is held is a lower
bound of the coefficient where that is not told: below, nothing slides.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tactopose_drake.core.tracking.frame import ContactReading
from tactopose_drake.core.tracking.tracker_params import ForceTestParams
from tactopose_drake.core.validation import FloatArray


class ForceTest(NamedTuple):
    """What the test remembers.

    Attributes:
        times: of the latest frames, oldest first, s.
        forces: of each source then, shape (h, s, 3), N; 0 where one does not touch.
        ratio: of tangential to normal force, the largest since the object is held, but for the last moments.
        noise: by how much of their size forces change in the mean.
        held_time: since when no finger came to touch anew, s.
        inside_time: when a finger was last within its cone of friction, rather than at its limit, s.
    """

    times: tuple[float, ...] = ()
    forces: FloatArray = np.zeros((0, 0, 3))
    ratio: float = 0.0
    noise: float = 0.0
    held_time: float = -np.inf
    inside_time: float = -np.inf


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
    contacts = reading.evidence.contacts
    held_time = time if is_new else test.held_time
    if contacts.f_PC is None or contacts.n_PC is None:
        return ForceTest(held_time=held_time), False
    now = np.zeros((1, len(reading.sources), 3))
    now[0, reading.source[: len(contacts)]] = contacts.f_PC
    before = np.zeros((len(test.times), now.shape[1], 3))
    before[:, : test.forces.shape[1]] = test.forces
    recent = [i for i, then in enumerate(test.times) if then >= time - params.time]
    before = before[recent]
    times = (*(test.times[i] for i in recent), time)
    kept = test._replace(times=times, forces=np.concatenate([before, now]), held_time=held_time)
    ratios = _ratios(params, contacts.f_PC, contacts.n_PC)
    if time < held_time + params.settling_time or not len(ratios):
        return kept._replace(ratio=0.0, noise=0.0, inside_time=-np.inf) if is_new else kept, False
    largest = min(float(ratios.max()), params.most_ratio)
    ratio = test.ratio + params.gain * max(largest - test.ratio, 0.0) if test.ratio > 0.0 else largest
    at_limit = ratios > params.limit_share * max(ratio, params.least_ratio)
    change = _change(before[0], now[0]) if len(before) else 0.0
    noise = test.noise + params.gain * (min(change, params.change) - test.noise)
    kept = kept._replace(ratio=ratio, noise=noise, inside_time=test.inside_time if at_limit.all() else time)
    are_alike = len(ratios) >= params.least_fingers and np.ptp(ratios) < params.alike * ratios.mean()
    slides = are_alike and at_limit.all() and time < kept.inside_time + params.reaching_time
    gives_way = at_limit.any() and change > max(params.change, params.noises * test.noise)
    return kept, bool(slides or gives_way)


def _ratios(params: ForceTestParams, f_PC: FloatArray, n_PC: FloatArray) -> FloatArray:
    """Of tangential to normal force, of the contacts (k, 3) that bear a load."""
    size = np.linalg.norm(f_PC, axis=1)
    along = np.abs(np.einsum("ki,ki->k", f_PC, n_PC))
    across = np.sqrt(np.maximum(size**2 - along**2, 0.0))
    bears = size > max(params.least_force, params.least_share * float(size.sum()))
    return np.asarray((across / np.maximum(along, 1e-3 * size + 1e-12))[bears])


def _change(before: FloatArray, now: FloatArray) -> float:
    """Of forces (s, 3), relative to the larger ones."""
    largest = max(float(np.sum(before**2)), float(np.sum(now**2)), 1e-12)
    return float(np.sqrt(np.sum((now - before) ** 2) / largest))
