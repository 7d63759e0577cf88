"""Conversion of the encoder counts and strain readings of Barrett's BH8-280 hand to angles and torques, and back.

Sources: [L] libbarrett, [W] WUT's and [R] Robotnik's drivers. Gear ratios: the motor turns 125 times per turn of the
inner link, and 375 times per turn of the outer link. [O] (owd) adds 42 degrees, the outer link's angle at rest.
"""

import math
from collections.abc import Sequence

import numpy as np

from tactopose_drake.core.validation import FloatArray
from tactopose_drake.errors import ProtocolError

JOINTS = ("F1_inner", "F2_inner", "F3_inner", "F1_outer", "F2_outer", "F3_outer", "spread")
STRAIN_MAX = 4095
# Beyond these limits, the finger's torque is about 1.14 N m, and the finger moves by itself.
STRAIN_LIMITS = (667, 3460)
# The polynomial of [R], highest power first, N m; its origin is unknown. Calibrate each finger.
STRAIN_POLYNOMIAL = (2.754e-10, -1.708e-6, 3.764e-3, -2.85)

_RADIANS = 2 * math.pi / 4096  # per encoder count
_INNER, _OUTER, _JOINT, _SPREAD = 125.0, 375.0, 50.0, 35840 / math.pi
# The zero of a joint that has not been initialized is its position at power-up, so counts may be negative. Counts that
# exceed the joint's range by more than a tenth are invalid.
_MOTOR_MAX, _JOINT_MAX, _SPREAD_MAX = 219_000, 87_600, 39_400


def finger_angles(motor: int, joint: int | None) -> tuple[float, float]:
    """Angles of the inner and the outer link, rad.

    Args:
        motor: counts of the motor.
        joint: counts of the inner link's own encoder. None if it has none; the clutch is then assumed to be closed, so
            that both links move together.

    Raises:
        ProtocolError: if a count is beyond the joint's range.
    """
    _within("motor position", motor, _MOTOR_MAX)
    if joint is None:
        inner = _RADIANS * motor / _INNER
        return inner, inner / 3
    _within("joint position", joint, _JOINT_MAX)
    inner = _RADIANS * joint / _JOINT
    return inner, _RADIANS * motor * (1 / _INNER + 1 / _OUTER) - inner


def finger_counts(inner: float, outer: float) -> tuple[int, int]:
    """Counts of the motor and of the inner link's encoder at these angles, rad."""
    motor = (inner + outer) / (_RADIANS * (1 / _INNER + 1 / _OUTER))
    return round(motor), round(inner * _JOINT / _RADIANS)


def spread_angle(motor: int) -> float:
    """Angle of the spread, rad.

    Raises:
        ProtocolError: if the count is beyond the joint's range.
    """
    _within("spread position", motor, _SPREAD_MAX)
    return motor / _SPREAD


def spread_counts(angle: float) -> int:
    """Counts of the spread's motor at this angle, rad."""
    return round(angle * _SPREAD)


def fingertip_torque(strain: int, polynomial: Sequence[float] = STRAIN_POLYNOMIAL) -> float:
    """Torque about a finger's outer joint, N m.

    Args:
        strain: the gauge's reading, 0 to 4095.
        polynomial: from reading to torque, highest power first.

    Raises:
        ProtocolError: if the reading does not have 12 bits.
    """
    if not 0 <= strain <= STRAIN_MAX:
        raise ProtocolError(f"strain must be from 0 to {STRAIN_MAX}, not {strain}.")
    return float(np.polyval(polynomial, strain))


def strain_of(torque: float) -> int:
    """The gauge's reading whose torque by `STRAIN_POLYNOMIAL`, an increasing function, is nearest to this one, N m."""
    torques: FloatArray = np.polyval(np.asarray(STRAIN_POLYNOMIAL, np.float64), np.arange(STRAIN_MAX + 1.0))
    return int(np.argmin(np.abs(torques - torque)))


def _within(name: str, count: int, largest: int) -> None:
    if abs(count) > largest:
        raise ProtocolError(f"{name} must be from -{largest} to {largest} counts, not {count}.")
