"""Meshes of solids of revolution are whole and of the right size, however slim or small the body is."""

import numpy as np
import pytest

from tactopose_drake.core.mesh.primitives import capsule_mesh, cylinder_mesh

SIZES = [(0.0005, 0.1), (0.004, 0.008), (0.012, 0.05), (0.03, 0.02), (0.2, 0.3)]  # radius and length, m


@pytest.mark.parametrize(("radius", "length"), SIZES)
def test_a_capsule_is_closed_and_reaches_to_its_poles(radius: float, length: float) -> None:
    mesh = capsule_mesh(radius, length)
    assert mesh.is_volume
    np.testing.assert_allclose(np.abs(mesh.bounds[:, 2]), 0.5 * length + radius, rtol=1e-12)
    assert mesh.volume == pytest.approx(np.pi * radius**2 * (length + 4.0 / 3.0 * radius), rel=2e-3)


@pytest.mark.parametrize(("radius", "length"), SIZES)
def test_a_cylinder_is_closed(radius: float, length: float) -> None:
    mesh = cylinder_mesh(radius, length)
    assert mesh.is_volume
    assert mesh.volume == pytest.approx(np.pi * radius**2 * length, rel=2e-3)
