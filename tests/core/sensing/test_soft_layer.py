import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tactopose_drake.core.sensing.intrinsic_contact import solve_contact, solve_contacts
from tactopose_drake.core.sensing.soft_layer import SoftLayer
from tactopose_drake.core.surfaces import Capsule, Ellipsoid, Sphere, Surface
from tactopose_drake.errors import InvalidInputError
from tests.core.touches import SURFACES, placed, seeds, touch

# A crease has no radius that a layer could be pressed in by.
LAYERED = {name: surface for name, surface in SURFACES.items() if "pinched" not in name}
every_surface = pytest.mark.parametrize("surface", LAYERED.values(), ids=LAYERED)


@every_surface
@given(seed=seeds, stiffness=st.floats(2e3, 2e5))
@settings(max_examples=30)
def test_the_touched_point_is_found_through_the_layer(surface: Surface, seed: int, stiffness: float) -> None:
    generator = np.random.default_rng(seed)
    surface = placed(surface, generator)
    layer = SoftLayer(thickness=0.002, stiffness=stiffness)
    touches = touch(surface, generator, 50, force=1.0, layer=layer)
    found = solve_contacts(touches.F_S, surface, layer=layer)
    assert found.valid.mean() > 0.9  # sharp edges of a box have less radius than the deformation
    p_SC, n_S = touches.p_SC[found.valid], touches.n_S[found.valid]
    np.testing.assert_allclose(found.p_SC[found.valid], p_SC, atol=1e-10)
    np.testing.assert_allclose(found.n_S[found.valid], n_S, atol=1e-7)
    normal_force = np.linalg.norm(found.normal_force[found.valid], axis=1)
    np.testing.assert_allclose(found.deformation[found.valid], normal_force / stiffness, rtol=1e-9)


@every_surface
@given(seed=seeds)
@settings(max_examples=20)
def test_an_ever_stiffer_layer_becomes_rigid(surface: Surface, seed: int) -> None:
    touches = touch(surface, np.random.default_rng(seed), 20)
    rigid = solve_contacts(touches.F_S, surface)
    previous = math.inf
    for stiffness in (1e6, 1e9, 1e12):
        found = solve_contacts(touches.F_S, surface, layer=SoftLayer(thickness=0.001, stiffness=stiffness))
        # Within a deformation of a cylinder's rim the contact lies beyond the end of the deformed surface.
        assert found.valid.mean() > 0.9
        distance = np.linalg.norm(found.p_SC - rigid.p_SC, axis=1)[found.valid].max()
        assert distance < 100.0 / stiffness + 1e-11
        assert distance < previous
        previous = distance


def test_a_straight_push_on_a_sphere_moves_in_by_force_over_stiffness() -> None:
    layer = SoftLayer(thickness=0.002, stiffness=5000.0)
    solution = solve_contact([0, 0, 0, 0, 0, -4.0], Sphere(radius=0.009), layer=layer)
    np.testing.assert_allclose(solution.p_SC, [0, 0, 0.009 - 4.0 / 5000.0], atol=1e-15)
    assert solution.deformation == pytest.approx(8e-4)


def test_a_layer_is_not_pressed_in_by_more_than_the_surface_s_radius_where_it_is_touched() -> None:
    """A lens, whose radius at the rim is c^2 / a = 1.8 mm, less than its layer's thickness."""
    lens, layer = Ellipsoid((0.009, 0.009, 0.004)), SoftLayer(thickness=0.003, stiffness=1000.0)
    at_rim, folded = (solve_contact([0, 0, 0, -force, 0, 0], lens, layer=layer) for force in (1.7, 1.9))
    np.testing.assert_allclose(at_rim.p_SC, [0.009 - 0.0017, 0.0, 0.0], atol=1e-12)
    assert not folded.valid
    assert folded.reason == "the soft layer is pressed in by more than its thickness or the surface's radius"
    assert solve_contact([0, 0, 0, 0, 0, -2.5], lens, layer=layer).valid  # Its middle is flat.


def test_neglecting_the_layer_costs_accuracy() -> None:
    layer = SoftLayer(thickness=0.003, stiffness=5000.0)
    surface = Capsule(radius=0.009, length=0.014)
    touches = touch(surface, np.random.default_rng(0), 100, force=5.0, layer=layer)
    rigid = solve_contacts(touches.F_S, surface)
    assert np.nanmedian(np.linalg.norm(rigid.p_SC - touches.p_SC, axis=1)) > 5e-4


def test_a_layer_pressed_through_is_no_contact() -> None:
    layer = SoftLayer(thickness=0.001, stiffness=5000.0)
    push = np.array([0, 0, 0, 0, 0, -1.0])
    assert solve_contact(4.999 * push, Sphere(radius=0.009), layer=layer).valid
    pressed = solve_contact(5.001 * push, Sphere(radius=0.009), layer=layer)
    assert not pressed.valid
    assert pressed.reason == "the soft layer is pressed in by more than its thickness or the surface's radius"


def test_a_layer_pressed_in_beyond_the_radius_of_curvature_is_no_contact() -> None:
    # The tip's radius of curvature is a^2 / c = 0.5 mm.
    needle = Ellipsoid(semi_axes=(0.003, 0.003, 0.018))
    layer = SoftLayer(thickness=0.002, stiffness=1000.0)
    assert solve_contact([0, 0, 0, 0, 0, -0.4], needle, layer=layer).valid
    assert not solve_contact([0, 0, 0, 0, 0, -0.6], needle, layer=layer).valid


@pytest.mark.parametrize(
    ("thickness", "stiffness", "message"),
    [
        (0.0, 1.0, "thickness must be .*, not 0"),
        (0.001, -1.0, "stiffness must be .*, not -1"),
        (math.nan, 1.0, "thickness must be .*, not nan"),
        (0.001, 10.0, r"stiffness must be a number from 50 to 1e\+12 N/m, not 10"),
    ],
)
def test_impossible_layers_are_refused(thickness: float, stiffness: float, message: str) -> None:
    with pytest.raises(InvalidInputError, match=message):
        SoftLayer(thickness=thickness, stiffness=stiffness)


@every_surface
def test_a_layer_must_leave_a_core(surface: Surface) -> None:
    half_width = 0.008 if surface.shape[1] == 0.008 else 0.009
    push = [0, 0, 0, 0, -1.0, 0]
    solve_contact(push, surface, layer=SoftLayer(thickness=0.99 * half_width, stiffness=1e4))
    with pytest.raises(InvalidInputError, match=r"thickness must be less than .*, 0\.00"):
        solve_contact(push, surface, layer=SoftLayer(thickness=half_width, stiffness=1e4))
