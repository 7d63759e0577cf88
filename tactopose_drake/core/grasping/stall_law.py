"""The law of motors that close until they stall and then hold without power, as worm drives do."""

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
        commanded: positions, shape (k,), rad, or m of joints that slide.
        measured: positions, shape (k,), likewise.
        stalled: which motors have stalled before, shape (k,); they hold their command whatever comes.
        step: how far a command moves on, a number or shape (k,); below 0 where closing makes positions smaller.
        reach: how far ahead of its joint a command is when the motor stalls: stall torque over stiffness; likewise.

    Returns:
        The new commands and which motors have stalled now.
    """
    stalled = stalled | (np.sign(step) * (commanded - measured) >= reach)
    return np.where(stalled, commanded, commanded + step), stalled
