import numpy as np

from tactopose_drake.core.shape.morton_order import morton_codes


def test_cells_come_along_the_curve_by_the_digits_of_their_numbers_in_turn() -> None:
    """All of a cube's octant before any of the next, and in each the same again; x turns fastest."""
    n = np.arange(8)
    cells = np.stack(np.meshgrid(n, n, n, indexing="ij"), axis=-1).reshape(-1, 3)
    codes = morton_codes(cells, 3)
    assert sorted(codes) == list(range(512))
    written = ["".join(f"{z:03b}"[i] + f"{y:03b}"[i] + f"{x:03b}"[i] for i in range(3)) for x, y, z in cells]
    np.testing.assert_array_equal(codes, [int(digits, 2) for digits in written])
    np.testing.assert_array_equal(morton_codes(cells, 2), codes % 64)
