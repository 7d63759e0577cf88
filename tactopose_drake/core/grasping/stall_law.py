"""The control law of motors that close until they stall and then hold without power, as worm drives do."""

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.validation import FloatArray


def close_until_stalled(
    commanded: FloatArray,
    measured: FloatArray,
    stalled: NDArray[np.bool_],
    *,
    step: FloatArray | float,
    reach: FloatArray | float,
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """One step of the commanded positions.

    Args:
        commanded: positions, shape (k,), rad, or m for sliding joints; NaN to begin at the measured ones.
        measured: positions, shape (k,), rad or m; NaN where unknown, which such a motor waits for.
        stalled: which motors have stalled before, shape (k,); they hold their command from then on.
        step: increment of a command, a number or shape (k,), rad or m; negative if closing decreases the position.
        reach: how far a command is ahead of its joint when the motor stalls: stall torque over stiffness, a number or
            shape (k,), rad or m.

    Returns:
        The new commands, and which motors have stalled by now.
    """
    commanded = np.where(np.isnan(commanded), measured, commanded)
    stalled = stalled | (np.sign(step) * (commanded - measured) >= reach)
    return np.where(stalled | np.isnan(measured), commanded, commanded + step), stalled
