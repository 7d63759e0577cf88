"""The measurement of a six-axis force-torque sensor: load, noise, bias, drift, range and quantisation.

A load is a wrench F_S = [m_x, m_y, m_z, f_x, f_y, f_z] on the fingertip, about the origin of the sensor's frame S,
expressed in S. The order of the steps is that of a real instrument: its strain gauges carry the fingertip's weight too,
so range and quantisation apply to the sum, and the weight is subtracted afterwards.
"""

import dataclasses
import math

import numpy as np

from tactopose_drake.core.poses import skew
from tactopose_drake.core.validation import FloatArray, finite_array, positive_numbers

AXES = ("m_x", "m_y", "m_z", "f_x", "f_y", "f_z")
GRAVITY_W = np.array([0.0, 0.0, -9.81])
"""The acceleration of gravity in the world, m/s^2: Drake's default."""


@dataclasses.dataclass(kw_only=True, slots=True)
class ForceTorqueModel:
    """The limits of a force-torque sensor. Lists of six are in the order m_x, m_y, m_z, f_x, f_y, f_z.

    The defaults are an ideal sensor.
    """

    range: list[float] = dataclasses.field(default_factory=lambda: [1.0e9] * 6)  # largest magnitude, N m and N
    resolution: list[float] = dataclasses.field(
        default_factory=lambda: [0.0] * 6
    )  # quantisation step, N m and N; 0: none
    noise: list[float] = dataclasses.field(default_factory=lambda: [0.0] * 6)  # standard deviation, N m and N
    bias: list[float] = dataclasses.field(default_factory=lambda: [0.0] * 6)  # constant offset, N m and N
    drift: list[float] = dataclasses.field(default_factory=lambda: [0.0] * 6)  # of the offset, N m/s and N/s

    def validate(self) -> None:
        """Checks every field.

        Raises:
            InvalidInputError: a list that is not six finite numbers, a range <= 0, a resolution or noise < 0.
        """
        for name in ("range", "resolution", "noise"):
            positive_numbers(f"ForceTorqueModel.{name}", getattr(self, name), (6,), allow_zero=name != "range")
        for name in ("bias", "drift"):
            finite_array(f"ForceTorqueModel.{name}", getattr(self, name), (6,))


@dataclasses.dataclass(frozen=True, eq=False)
class Measurement:
    """One sample of a force-torque sensor.

    Attributes:
        F_S: measured wrench, shape (6,), N m and N; NaN where the load was NaN.
        saturated: which of the six axes are at the end of their range, shape (6,), bool.
    """

    F_S: FloatArray
    saturated: np.ndarray[tuple[int], np.dtype[np.bool_]]

    @property
    def status(self) -> str:
        """One of "ok", "no signal", or "saturated: " and the axes."""
        if not np.all(np.isfinite(self.F_S)):
            return "no signal"
        if self.saturated.any():
            return "saturated: " + ", ".join(np.array(AXES)[self.saturated])
        return "ok"


def measure(F_S: FloatArray, normal_noise: FloatArray, model: ForceTorqueModel, time: float = 0.0) -> Measurement:
    """The sensor's reading under the load F_S.

    Args:
        F_S: load, shape (6,), N m and N.
        normal_noise: standard normal numbers, shape (6,).
        model: the sensor's limits, valid.
        time: over which its bias has drifted, s.
    """
    reading, saturated = [], []
    each = F_S.tolist(), normal_noise.tolist(), model.noise, model.bias, model.drift, model.range, model.resolution
    for load, normal, sigma, bias, drift, largest, step in zip(*each, strict=True):  # Six numbers: faster than numpy.
        signal = load + bias + time * drift + sigma * normal
        is_rounded = step > 0.0 and math.isfinite(signal)
        rounded = step * round(signal / step) if is_rounded else signal
        # The range need not be a multiple of the resolution; an axis at its end reads the range itself.
        is_at_end = abs(signal) >= largest
        reading.append(math.copysign(largest, signal) if is_at_end else min(max(rounded, -largest), largest))
        saturated.append(is_at_end)
    return Measurement(np.array(reading), np.array(saturated))


def weight_matrix(mass: float, p_SScm: FloatArray) -> FloatArray:
    """The matrix that maps the acceleration of gravity in S, m/s^2, to a body's weight as a wrench about S's origin.

    Args:
        mass: kg.
        p_SScm: centre of mass in S, shape (3,), m.

    Returns:
        Shape (6, 3).
    """
    return mass * np.concatenate([skew(p_SScm), np.eye(3)])


def shift_matrix(X_SJ: FloatArray) -> FloatArray:
    """The matrix that maps a wrench [m, f] about the origin of J, in J, to the same wrench about the origin of S, in S.

    Args:
        X_SJ: pose of J in S, shape (3, 4).

    Returns:
        Shape (6, 6).
    """
    R_SJ = X_SJ[:, :3]
    return np.block([[R_SJ, skew(X_SJ[:, 3]) @ R_SJ], [np.zeros((3, 3)), R_SJ]])
