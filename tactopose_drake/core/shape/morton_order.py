"""An order of points in space along a curve that fills it, so that neighbours mostly follow on each other.

Source: [M66] G. Morton, A computer oriented geodetic data base, IBM, 1966.
"""

import numpy as np
from numpy.typing import NDArray


def morton_codes(cells: NDArray[np.int64], bits: int) -> NDArray[np.int64]:
    """Where cells come along the curve: so many bits of their three numbers, one of each in turn [M66], shape (n,).

    Args:
        cells: numbers from 0 to below 2^bits along each axis, shape (n, 3).
        bits: of each number, up to 20.
    """
    codes = np.zeros(len(cells), dtype=np.int64)
    for bit in range(bits):
        for axis in range(3):
            codes |= ((cells[:, axis] >> bit) & 1) << (3 * bit + axis)
    return codes
