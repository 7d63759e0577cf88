import numpy as np
import pytest

from tactopose_drake.core.kernels.matrix_kernels import eigenpairs, inverses, multiply, transform


def matrices(count: int, spread: float) -> np.ndarray:
    """Symmetric positive definite ones (count, 6, 6), whose eigenvalues differ by so many decades."""
    generator = np.random.default_rng(0)
    bases = np.linalg.qr(generator.normal(size=(count, 6, 6)))[0]
    values = 10.0 ** generator.uniform(-spread, spread, size=(count, 6))
    A: np.ndarray = (bases * values[:, None]) @ np.swapaxes(bases, 1, 2)
    return A


@pytest.mark.parametrize("spread", [0.1, 2.0, 4.0])
def test_inverses_and_determinants(spread: float) -> None:
    A = matrices(50, spread)
    inverse, logarithm = inverses(A)
    np.testing.assert_allclose(inverse @ A, np.tile(np.eye(6), (50, 1, 1)), atol=10.0 ** (2.0 * spread - 14.0))
    np.testing.assert_allclose(logarithm, np.linalg.slogdet(A)[1], atol=1e-6)


def test_a_matrix_that_is_not_positive_definite_has_no_inverse() -> None:
    A = matrices(3, 1.0)
    A[1] -= np.eye(6) * 2.0 * np.linalg.eigvalsh(A[1])[0]
    inverse, logarithm = inverses(A)
    np.testing.assert_array_equal(np.isinf(logarithm), [False, True, False])
    assert np.isfinite(inverse[[0, 2]]).all()


@pytest.mark.parametrize("spread", [0.0, 0.1, 2.0, 6.0])
def test_eigenvectors_are_orthonormal_and_only_scaled(spread: float) -> None:
    A = matrices(50, spread)
    A[0] = np.diag(np.arange(6.0) - 2.0)
    A[1, 0, 1] = 0.0  # Symmetric but for rounding.
    A[1, 1, 0] = 1e-18
    values, rows = eigenpairs(A)
    np.testing.assert_allclose(rows @ np.swapaxes(rows, 1, 2), np.tile(np.eye(6), (50, 1, 1)), atol=1e-13)
    size = np.abs(values).max(axis=1)[:, None, None]
    np.testing.assert_allclose(rows @ A / size, values[:, :, None] * rows / size, atol=1e-13)
    np.testing.assert_allclose(np.sort(values) / size[:, 0], np.linalg.eigvalsh(A) / size[:, 0], atol=1e-13)


def test_products() -> None:
    generator = np.random.default_rng(0)
    U, A, B = generator.normal(size=(4, 6)), matrices(1, 1.0)[0], generator.normal(size=(6, 3))
    product, work, transformed = np.empty((4, 3)), np.empty((4, 6)), np.empty((4, 4))
    multiply(U, B, product)
    transform(U, A, work, transformed)
    np.testing.assert_allclose(product, U @ B)
    np.testing.assert_allclose(transformed, U @ A @ U.T)
    np.testing.assert_array_equal(transformed, transformed.T)
