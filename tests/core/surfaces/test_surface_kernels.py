import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tactopose_drake.core.surfaces import Surface
from tactopose_drake.core.surfaces.surface_kernels import project
from tests.core.touches import SURFACES, seeds


@pytest.mark.parametrize("surface", SURFACES.values(), ids=SURFACES)
@given(seed=seeds, scale=st.floats(0.2, 5.0))
@settings(max_examples=20)
def test_projection_reaches_the_surface_along_the_ray(surface: Surface, seed: int, scale: float) -> None:
    q = surface.sample(np.random.default_rng(seed), 1)[0]
    axis = np.array([0.0, 0.0, np.clip(q[2], surface.shape[1], surface.shape[2]) if surface.kind else 0.0])
    moved = axis + scale * (q - axis)
    project(surface.kind, surface.shape, moved)
    np.testing.assert_allclose(moved, q, atol=1e-15)
