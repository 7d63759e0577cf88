"""Detects a fingertip that slides on the object by the motion of the fingertips.

At a fingertip that rolls on the object or sticks to it, the touching point has the object's velocity v + w x p. For k
fingertips these are 3 k equations in six unknowns, the loop closure of hand and object. The residual of their
displacements within a short time is the innovation: while all hold, it comes from the noise of the measured velocities,
which is estimated from frame-to-frame changes, and from errors of the kinematics in proportion to the fingertips'
paths. Its normalised square is chi-square with f = 3 k - 6 degrees of freedom until one slides. As the estimate of the
noise averages a few frames only, it has h degrees of freedom itself, and their ratio has an F distribution: of that, (h
+ f / 2 - 1) log(1 + f F / h) is nearly chi-square with f degrees of freedom [B37]. A velocity that stays the same to
the last bit is held over from the frame before, with its noise.

Source: [B37] M. Bartlett, Properties of sufficiency and statistical tests, Proc. Royal Society A 160, 1937.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from tactopose_drake.core.evidence.contact_reading import ContactReading
from tactopose_drake.core.posterior.chi_square import chi_square_limit
from tactopose_drake.core.slip import slip_kernels
from tactopose_drake.core.slip.slip_params import RigidityTestParams
from tactopose_drake.core.times import has_passed
from tactopose_drake.core.validation import FloatArray

BY_MOTION = "the fingertips move otherwise than on one rigid object"
"""The reason given for a slip that this test detects."""

_LEAST_CONTACTS = 3  # two constrain the distance between them only
_MOST_GROWTH = 4.0  # factor by which one frame may raise the noise


class RigidityTest(NamedTuple):
    """The state of the test.

    Attributes:
        times: of the latest frames, oldest first, s.
        displacements: in each of them, of the fingertips where they touch, by source, shape (h, s, 3), m; NaN for a
            source that does not touch, or has just touched, as nothing constrained its path there.
        touching: names of the sources that touched in the last of them.
        noise: variance of the velocities' errors, of each coordinate, m^2/s^2; None before the first frame.
        readings: index of the velocity reading that each frame uses, counted from any number.
        velocity: the last one, by source, shape (s, 6), rad/s and m/s; NaN for sources that did not stay in touch.
        durations: of each of the latest frames, since the one before, s.
    """

    times: tuple[float, ...] = ()
    displacements: FloatArray = np.zeros((0, 0, 3))
    touching: frozenset[str] = frozenset()
    noise: float | None = None
    readings: tuple[int, ...] = ()
    velocity: FloatArray = np.zeros((0, 6))
    durations: tuple[float, ...] = ()


def detect_by_motion(
    params: RigidityTestParams,
    test: RigidityTest,
    reading: ContactReading,
    tip_velocity: Mapping[str, FloatArray] | None,
    time: float,
    duration: float,
) -> tuple[RigidityTest, bool]:
    """Updates the test with a frame, and tells whether a fingertip slides.

    Args:
        params: thresholds.
        test: after the last frame.
        reading: the contacts.
        tip_velocity: spatial velocities [w, v] of the fingertips at the origin of P, by source, rad/s and m/s.
        time: of the frame, s.
        duration: since the last frame, s.
    """
    if tip_velocity is None:
        return RigidityTest(noise=test.noise), False
    if duration <= 0.0:  # Nothing has moved since.
        return test, False
    names, noise = reading.sources, params.velocity_noise**2 if test.noise is None else test.noise
    touching = frozenset(frame_names := [names[s] for s in reading.source])
    stay = [row for row, name in enumerate(frame_names) if name in test.touching and name in tip_velocity]
    velocity = np.array([tip_velocity[frame_names[row]] for row in stay]).reshape(-1, 6)
    first = sum(has_passed(time, then, params.time) for then in test.times)
    before, squares = test.displacements[first:], np.empty(3)
    displacements = np.full((len(before) + 1, len(names), 3), np.nan)
    displacements[:-1, : before.shape[1]] = before
    p_PC, source = reading.contacts.p_PC[stay], reading.source[stay]
    steady = slip_kernels.add_displacements(source, p_PC, velocity, duration, displacements, squares)
    is_held = len(before) > 0 and source.max(initial=-1) < len(test.velocity)
    is_held = is_held and np.array_equal(velocity, test.velocity[source])
    readings = (*test.readings[first:], (test.readings[-1] if is_held else test.readings[-1] + 1) if len(before) else 0)
    last = np.full((len(names), 6), np.nan)
    last[source] = velocity
    durations = *test.durations[first:], duration
    test = RigidityTest((*test.times[first:], time), displacements, touching, noise, readings, last, durations)
    if steady < _LEAST_CONTACTS:
        return test, False
    unexplained, of_change, of_ways = squares.tolist()
    freedom = 3 * steady - 6
    if len(before) and not is_held:
        # The variance of a difference of independent errors is the sum of theirs. A steady slide cancels in it.
        seen = of_change / (freedom * (durations[-1] ** 2 + durations[-2] ** 2))
        seen = min(max(seen, params.least_velocity_noise**2), _MOST_GROWTH * noise)
        test = test._replace(noise=noise + params.noise_gain * (seen - noise))
    # Noise adds up as a random walk over readings; errors of the kinematics are proportional to the path.
    held = np.bincount(np.subtract(readings, readings[0]), weights=durations)
    variance = noise * float(held @ held) + params.way_share**2 * of_ways / (3 * steady)
    is_news = unexplained > variance * _limit(freedom, params)
    return test, bool(is_news and unexplained > steady * params.least_distance**2)


def _limit(freedom: int, params: RigidityTestParams) -> float:
    """The sum of squares over an estimated variance that noise alone exceeds with the probability of false alarms."""
    of_noise = freedom * (2.0 / params.noise_gain - 1.0)  # of exponential smoothing over independent frames
    log_ratio = chi_square_limit(freedom, params.false_alarm_probability) / (of_noise + 0.5 * freedom - 1.0)
    return of_noise * math.expm1(log_ratio)
