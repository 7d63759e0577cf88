"""Validation of a pad's data: its cells, their pressures, and its misplacement."""

import math

import numpy as np
from numpy.typing import ArrayLike

from tactopose_drake.core.geometry_checks import points_near
from tactopose_drake.core.validation import FloatArray, check_count, limited, number_array, positive_number
from tactopose_drake.errors import InvalidInputError

DEEPEST = 0.1
"""Largest depth that a pad may be pressed in, m; a larger one must be in another unit."""

_LARGEST = 1.0  # extent of a pad, m: a larger one must be in millimetres
_MOST_PRESSURE = 1e12  # Pa
_MOST_MISPLACEMENT = 1e2  # m^2 and rad^2
_ROUNDING = 1e-9  # relative to a covariance's largest entry, and to the largest depth


def checked_cells(value: ArrayLike) -> FloatArray:
    """Checks cells (n, 3), m."""
    p_PT = points_near("p_PT", value, (None, 3))
    check_count("p_PT", len(p_PT), "cells")
    extent = float(np.ptp(p_PT, axis=0).max())
    if extent > _LARGEST:
        raise InvalidInputError(
            f"p_PT must be spread over at most {_LARGEST:g} m, not {extent:g} m. Multiply by 0.001 what is in "
            "millimetres."
        )
    return p_PT


def check_depths(alpha: float, pressure: FloatArray, threshold: float) -> None:
    """Raises InvalidInputError if a live cell's depth, or the threshold's, exceeds `DEEPEST`."""
    if alpha * threshold > (1.0 + _ROUNDING) * DEEPEST:
        raise InvalidInputError(
            f"threshold must be a depth up to {DEEPEST:g} m, not {alpha * threshold:g} m, which {threshold:g} Pa at "
            f"alpha = {alpha:g} m/Pa are."
        )
    index = int(np.nanargmax(pressure))
    if alpha * pressure[index] > (1.0 + _ROUNDING) * DEEPEST:
        raise InvalidInputError(
            f"pressure[{index}] must be a depth up to {DEEPEST:g} m, not {alpha * pressure[index]:g} m, which "
            f"{pressure[index]:g} Pa at alpha = {alpha:g} m/Pa are."
        )


def checked_range(threshold: float, saturation: float | None) -> tuple[float, float]:
    """Checks the pressure above which a cell is active, Pa, and the highest that it can read."""
    least = positive_number("threshold", threshold, allow_zero=True)
    limited("threshold", least, (), most=_MOST_PRESSURE)
    is_infinite = isinstance(saturation, float) and saturation == math.inf  # As `Patch.saturation` is without a limit.
    most = math.inf if saturation is None or is_infinite else positive_number("saturation", saturation)
    if most <= least:
        raise InvalidInputError(f"saturation must be a number > threshold = {least:g}, not {most:g}.")
    return least, most


def checked_pressures(value: ArrayLike, count: int) -> FloatArray:
    """Checks pressures (n,), NaN for dead cells."""
    pressure = number_array("pressure", value, (count,))
    dead = np.isnan(pressure)
    limited("pressure", np.where(dead, 0.0, pressure), (count,), most=_MOST_PRESSURE)
    if dead.all():
        raise InvalidInputError("pressure must be known at one cell or more, but is NaN everywhere.")
    if np.any(pressure < 0):
        index = int(np.nanargmin(pressure))
        raise InvalidInputError(f"pressure[{index}] must be a number >= 0, or NaN, not {pressure[index]:g}.")
    return pressure


def checked_covariance(value: ArrayLike) -> FloatArray:
    """Checks a covariance (6, 6)."""
    covariance = limited("misplacement", value, (6, 6), most=_MOST_MISPLACEMENT)
    rounding = _ROUNDING * np.abs(covariance).max()
    off, least = np.abs(covariance - covariance.T).max(), np.linalg.eigvalsh(covariance)[0]
    if off > rounding:
        raise InvalidInputError(f"misplacement must be symmetric, not asymmetric by {off:.3g}.")
    if least < -rounding:
        raise InvalidInputError(f"misplacement must have no negative eigenvalue, not {least:.3g}.")
    return covariance
