from types import ModuleType

import numpy as np
import pytest

from tests.examples.scripts import share_script


@pytest.fixture(scope="module")
def script() -> ModuleType:
    return share_script("thesis/cube_and_cylinder.py")


def test_a_trial_is_a_pure_function_of_its_seed(script: ModuleType) -> None:
    shape = script.make_shapes()["cylinder"]
    first, again, other = (script.make_trial(shape, np.random.default_rng(seed)) for seed in (5, 5, 6))
    np.testing.assert_array_equal(first.contacts.p_PC, again.contacts.p_PC)
    np.testing.assert_array_equal(first.prior.mean, again.prior.mean)
    assert not np.array_equal(first.prior.mean, other.prior.mean)


def test_contacts_are_exact_and_away_from_the_edges(script: ModuleType) -> None:
    cylinder = script.make_shapes()["cylinder"]
    points = cylinder.model.samples.points[cylinder.touchable]
    radius, height = np.linalg.norm(points[:, :2], axis=1), np.abs(points[:, 2])
    on_side, on_cap = np.isclose(radius, 0.035, atol=1e-5), np.isclose(height, 0.055, atol=1e-9)
    assert np.all(on_side ^ on_cap)
    assert height[on_side].max() < 0.055 - 0.014
    assert radius[on_cap].max() < 0.035 - 0.014
