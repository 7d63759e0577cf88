"""Morton order: an order of points along a space-filling curve, in which neighbours mostly follow each other.

Source: [M66] G. Morton, A computer oriented geodetic data base, IBM, 1966.
"""

import numpy as np
from numpy.typing import NDArray


def morton_codes(cells: NDArray[np.int64], bits: int) -> NDArray[np.int64]:
    """Positions of cells along the curve: the interleaved bits of their three indices [M66], shape (n,).

    Args:
        cells: indices from 0 to below 2^bits along each axis, shape (n, 3).
        bits: of each index, up to 20.
    """
    codes = np.zeros(len(cells), dtype=np.int64)
    for bit in range(bits):
        for axis in range(3):
            codes |= ((cells[:, axis] >> bit) & 1) << (3 * bit + axis)
    return codes
