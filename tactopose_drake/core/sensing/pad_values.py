"""Validation of a pad's data: its cells, their pressures, and its misplacement."""

import math

import numpy as np
from numpy.typing import ArrayLike

from tactopose_drake.core.geometry_checks import points_near
from tactopose_drake.core.validation import FloatArray, limited, number_array, positive_number
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
    if len(p_PT) == 0:
        raise InvalidInputError("p_PT: is empty; must have at least one cell.")
    extent = float(np.ptp(p_PT, axis=0).max())
    if extent > _LARGEST:
        raise InvalidInputError(
            f"p_PT: the cells are spread over {extent:g} m; must be at most {_LARGEST:g} m. Multiply by 0.001 what "
            "is in millimetres."
        )
    return p_PT


def check_depths(alpha: float, pressure: FloatArray, threshold: float) -> None:
    """Raises InvalidInputError if a live cell's depth, or the threshold's, exceeds `DEEPEST`."""
    if alpha * threshold > (1.0 + _ROUNDING) * DEEPEST:
        raise InvalidInputError(
            f"threshold: {threshold:g} Pa at alpha = {alpha:g} m/Pa are {alpha * threshold:g} m; allowed are depths up "
            f"to {DEEPEST:g} m."
        )
    index = int(np.nanargmax(pressure))
    if alpha * pressure[index] > (1.0 + _ROUNDING) * DEEPEST:
        raise InvalidInputError(
            f"pressure[{index}]: {pressure[index]:g} Pa at alpha = {alpha:g} m/Pa are {alpha * pressure[index]:g} m; "
            f"allowed are depths up to {DEEPEST:g} m."
        )


def checked_range(threshold: float, saturation: float | None) -> tuple[float, float]:
    """Checks the pressure above which a cell is active, Pa, and the highest that it can read."""
    least = positive_number("threshold", threshold, allow_zero=True)
    limited("threshold", least, (), most=_MOST_PRESSURE)
    most = math.inf if saturation is None else positive_number("saturation", saturation)
    if most <= least:
        raise InvalidInputError(f"saturation: is {most:g}; allowed are numbers > threshold = {least:g}.")
    return least, most


def checked_pressures(value: ArrayLike, count: int) -> FloatArray:
    """Checks pressures (n,), NaN for dead cells."""
    pressure = number_array("pressure", value, (count,))
    dead = np.isnan(pressure)
    limited("pressure", np.where(dead, 0.0, pressure), (count,), most=_MOST_PRESSURE)
    if dead.all():
        raise InvalidInputError("pressure: every cell is NaN; at least one must be live.")
    if np.any(pressure < 0):
        index = int(np.nanargmin(pressure))
        raise InvalidInputError(f"pressure[{index}]: is {pressure[index]:g}; allowed are numbers >= 0, and NaN.")
    return pressure


def checked_covariance(value: ArrayLike) -> FloatArray:
    """Checks a covariance (6, 6)."""
    covariance = limited("misplacement", value, (6, 6), most=_MOST_MISPLACEMENT)
    rounding = _ROUNDING * np.abs(covariance).max()
    if np.abs(covariance - covariance.T).max() > rounding or np.linalg.eigvalsh(covariance)[0] < -rounding:
        raise InvalidInputError("misplacement: must be a covariance, symmetric and without negative eigenvalues.")
    return covariance
