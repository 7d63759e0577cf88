import numba
import numpy as np
import pytest

from tactopose_drake.core.kernels.linear_system_kernels import invert_columns


@numba.njit
def solve(A: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.linalg.solve(A, b)


@pytest.mark.parametrize("size", [6, 12, 42])
def test_columns_of_the_inverse_are_those_of_numpy_in_a_kernel(size: int) -> None:
    generator = np.random.default_rng(size)
    work, X = np.empty((size, size)), np.empty((6, size))
    for _ in range(20):
        A = generator.normal(size=(size, size))
        for matrix in (A, A @ A.T):
            invert_columns(matrix, work, X)
            np.testing.assert_array_equal(X.T, solve(matrix, np.eye(size, 6)))
            np.testing.assert_allclose(matrix @ X.T, np.eye(size, 6), atol=1e-6)


@pytest.mark.parametrize(("number", "message"), [(0.0, "singular"), (np.nan, "infs or NaNs"), (np.inf, "infs or NaNs")])
def test_what_has_no_inverse_is_refused(number: float, message: str) -> None:
    with pytest.raises(np.linalg.LinAlgError, match=message):
        invert_columns(np.full((6, 6), number), np.empty((6, 6)), np.empty((6, 6)))
