import numpy as np
import pytest

from tactopose_drake.errors import InvalidInputError
from tactopose_drake.hand.pad_calibration import (
    PAD_SIZE,
    AlphaFit,
    find_alpha,
    flat,
    patch_of,
    pressed_pad,
    simulate_presses,
    thesis_shapes,
    tilt_errors,
)

MODULUS, THICKNESS = 75e3, 0.006


@pytest.fixture(scope="module")
def fit() -> AlphaFit:
    return find_alpha(modulus=MODULUS, thickness=THICKNESS)


def test_no_patch_is_tilted_a_degree_more_or_less_than_its_shape(fit: AlphaFit) -> None:
    errors = np.degrees(np.abs(fit.errors))
    assert len(errors) == len(thesis_shapes()) * 4 * 3 * 4
    assert errors.max() <= 1.0
    assert errors.mean() <= 0.5
    assert fit.alpha == pytest.approx(THICKNESS / MODULUS, rel=0.1)


def test_no_other_alpha_is_better(fit: AlphaFit) -> None:
    best = np.sum(fit.errors**2)
    for factor in (0.98, 1.02):
        assert np.sum(tilt_errors(fit.layout, fit.presses, factor * fit.alpha) ** 2) > best


def test_a_stiffer_layer_has_a_smaller_alpha(fit: AlphaFit) -> None:
    assert find_alpha(modulus=3 * MODULUS, thickness=THICKNESS).alpha == pytest.approx(fit.alpha / 3, rel=1e-4)


def test_the_pressure_is_the_layers_modulus_times_its_strain() -> None:
    layout = pressed_pad(0.0025)
    for press in simulate_presses("flat", flat(0.1), layout, modulus=MODULUS, thickness=THICKNESS):
        depth = press.depth - np.tan(press.tilt) * (PAD_SIZE[0] / 2 - layout.p_TC[:, 0])
        covered = depth > 0.00125 * np.tan(press.tilt) + 1e-9
        np.testing.assert_allclose(press.pressure[covered], MODULUS * depth[covered] / THICKNESS, rtol=1e-6)
        untouched = depth < -0.00125 * np.tan(press.tilt) - 1e-9
        assert not press.pressure[untouched].any()


def test_each_shape_leaves_its_print(fit: AlphaFit) -> None:
    """The presses at no tilt, deepest, edges on the cells' edges."""
    cells = {}
    for press in fit.presses[8::48]:
        assert press.tilt == 0
        cells[press.shape] = patch_of(fit.layout, press, fit.alpha).active.reshape(40, 15)
    assert cells["flat, wide"].all()
    assert cells["flat, thin"].sum() == 40 * 9  # an 8 mm rib over cells whose middles are on its axis
    half_width = np.sqrt(0.035**2 - (0.035 - 0.4 * THICKNESS) ** 2)
    assert half_width > PAD_SIZE[1] / 2
    assert cells["cylinder"].all()
    legs = np.zeros((40, 15), dtype=bool)
    legs[32:], legs[:, 7:] = True, True  # at the end +x, and along the side -y, where rows end
    np.testing.assert_array_equal(cells["L-shape"], legs)


def test_the_tilt_error_is_signed_and_of_the_plane_of_the_tilt(fit: AlphaFit) -> None:
    (press,) = [p for p in fit.presses if p.shape == "flat, wide" and p.tilt > 0.1][8:9]
    errors = [tilt_errors(fit.layout, [press], factor * fit.alpha)[0] for factor in (0.5, 1.0, 2.0)]
    assert errors[0] < -np.radians(3) < errors[1] < np.radians(0.5) < errors[2]
    third = patch_of(fit.layout, press, fit.alpha).eigenvectors[:, 2]
    np.testing.assert_allclose(third, [-np.sin(press.tilt), 0, -np.cos(press.tilt)], atol=0.01)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"modulus": 0.0}, "modulus must be .*, not 0"),
        ({"thickness": -0.001}, "thickness must be .*, not -0.001"),
        ({"cell": 0.0}, "cell must be .*, not 0"),
        ({"cell": 0.008}, "cell must be at most 0.005 m, not 0.008 m"),
        ({"modulus": np.nan}, "modulus must be .*, not nan"),
    ],
)
def test_impossible_pads_are_named(values: dict[str, float], message: str) -> None:
    with pytest.raises(InvalidInputError, match=message):
        find_alpha(**({"modulus": MODULUS, "thickness": THICKNESS} | values))
