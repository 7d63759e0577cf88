import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tactopose_drake.core.sensing.contact_newton_kernels import Line, linearize
from tactopose_drake.core.surfaces import Surface
from tactopose_drake.core.surfaces.surface_kernels import project
from tests.core.touches import SURFACES, seeds


def residual(surface: Surface, m: np.ndarray, f: np.ndarray, compliance: float, q: np.ndarray) -> np.ndarray:
    """The tangential part of m - p x f at q, as a vector: independent of the choice of tangents."""
    n = surface.normal([q])[0]
    p = q + compliance * np.dot(f, n) * n
    e = m - np.cross(p, f)
    return e - np.dot(e, n) * n


@pytest.mark.parametrize("surface", SURFACES.values(), ids=SURFACES)
@given(seed=seeds, compliance=st.sampled_from([0.0, 1e-4, 1e-3]))
@settings(max_examples=40)
def test_the_jacobian_agrees_with_central_differences(surface: Surface, seed: int, compliance: float) -> None:
    generator = np.random.default_rng(seed)
    q = surface.sample(generator, 1)[0]
    m, f = generator.normal(scale=0.01, size=3), generator.normal(size=3)
    f /= np.linalg.norm(f)
    if np.abs(q).min() < 4e-4 or abs(abs(q[2]) - 0.007) < 1e-4:  # creases, and the seam between side and end
        return
    out = np.empty(18)
    linearize(surface.kind, surface.shape, Line(tuple(m), tuple(f), compliance), q, np.empty(3), np.empty((3, 3)), out)
    t = out[11:17].reshape(2, 3)
    n = out[8:11]
    np.testing.assert_allclose(n, surface.normal([q])[0], atol=1e-12)
    np.testing.assert_allclose(np.vstack([n, t]) @ np.vstack([n, t]).T, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(np.cross(t[0], t[1]), n, atol=1e-12)
    np.testing.assert_allclose(out[0:2], t @ residual(surface, m, f, compliance, q), atol=1e-15)

    step = 1e-8
    slopes = np.empty((2, 2))
    for j in range(2):
        ends = []
        for sign in (1.0, -1.0):
            there = q + sign * step * t[j]
            project(surface.kind, surface.shape, there)
            ends.append(residual(surface, m, f, compliance, there))
        slopes[:, j] = t @ (ends[0] - ends[1]) / (2 * step)
    np.testing.assert_allclose(out[2:6].reshape(2, 2), slopes, rtol=2e-5, atol=2e-5 * np.abs(slopes).max())


@pytest.mark.parametrize("surface", SURFACES.values(), ids=SURFACES)
@given(seed=seeds)
@settings(max_examples=20)
def test_the_rigid_jacobian_is_singular_only_where_the_force_is_tangent(surface: Surface, seed: int) -> None:
    """The determinant (f.n)^2 + torque^2 K, on which the uniqueness of the contact rests."""
    generator = np.random.default_rng(seed)
    q = surface.sample(generator, 1)[0]
    m, f = generator.normal(scale=0.01, size=3), generator.normal(size=3)
    out = np.empty(18)
    linearize(surface.kind, surface.shape, Line(tuple(m), tuple(f), 0.0), q, np.empty(3), np.empty((3, 3)), out)
    t = out[11:17].reshape(2, 3)
    gradient, hessian = surface.gradient([q])[0], surface.hessian([q])[0]
    W = t @ hessian @ t.T / np.linalg.norm(gradient)
    expected = out[6] ** 2 + out[7] ** 2 * np.linalg.det(W)
    assert np.linalg.det(out[2:6].reshape(2, 2)) == pytest.approx(expected, rel=1e-6)
    assert out[17] == pytest.approx(np.linalg.eigvalsh(W)[1], rel=1e-6, abs=1e-6)
