"""The generator of the shipped objects: it makes what is shipped, and its parts do what they say."""

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from .object_files import CATALOGUE, FOLDER, generate, shipped

# isort: split
from object_shapes import bust, files, lofts, pottery, sculpting, spray_bottle  # found by the generator

SCULPTED = {"mug": pottery._mug_field, "bust": bust._field, "spray_bottle": spray_bottle._field}


@pytest.mark.parametrize("name", [name for name in CATALOGUE if name not in SCULPTED])
def test_generator_makes_the_shipped_bytes(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    generate.main([name, "--out", str(tmp_path)])
    assert capsys.readouterr().out.startswith(f"[1/1] {name}: ")
    for suffix in (".obj", ".sdf"):
        assert (tmp_path / f"{name}{suffix}").read_bytes() == (FOLDER / f"{name}{suffix}").read_bytes()


@pytest.mark.parametrize("name", SCULPTED)
def test_sculpted_surface_is_the_fields(name: str) -> None:
    mesh = shipped(name)
    assert np.abs(SCULPTED[name](mesh.vertices)).max() < 2e-4
    assert np.percentile(np.abs(SCULPTED[name](mesh.vertices)), 99) < 3e-6
    assert np.percentile(np.abs(SCULPTED[name](mesh.triangles_center)), 95) < 2e-4
    spec = CATALOGUE[name]
    assert files.sdf_text(mesh, name, spec.mass, spec.friction, spec.color) == (FOLDER / f"{name}.sdf").read_text()


def _pear(p: NDArray[np.float64]) -> NDArray[np.float64]:
    return sculpting.length(p * np.array([1.0, 1.1, 0.8])) - 0.02 - 0.1 * p[..., 2]


BOUNDS = [[-0.03, -0.03, -0.03], [0.03, 0.03, 0.035]]


def test_sculpting_repeats_itself_with_well_shaped_triangles() -> None:
    one, two = (sculpting.sculpt(_pear, BOUNDS, 0.002, 1e-4, (0.0015, 0.006)) for _ in range(2))
    assert np.array_equal(one.vertices, two.vertices)
    assert np.array_equal(one.faces, two.faces)
    assert one.is_watertight
    assert one.volume > 0
    assert np.degrees(one.face_angles.min()) > 15
    assert np.abs(_pear(one.vertices)).max() < 1e-6
    assert np.abs(_pear(one.triangles_center)).max() < 4e-4


def test_sculpting_refuses_a_surface_that_is_not_one_closed_piece() -> None:
    with pytest.raises(ValueError, match="leaves the bounds"):
        sculpting.sculpt(_pear, [[-0.03, -0.03, -0.01], [0.03, 0.03, 0.035]], 0.002, 1e-4, (0.0015, 0.006))

    shift = np.array([0.015, 0.0, 0.0])

    def two_balls(p: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.minimum(sculpting.length(p - shift), sculpting.length(p + shift)) - 0.01

    with pytest.raises(ValueError, match="2 bodies"):
        sculpting.sculpt(two_balls, BOUNDS, 0.002, 1e-4, (0.0015, 0.006))


def test_profiles_and_lofts_refuse_what_they_cannot_make() -> None:
    with pytest.raises(ValueError, match="fillets need"):
        lofts.rounded_profile([(0, 0, 0), (0.01, 0, 0.02), (0.01, 0.05, 0.001), (0, 0.05, 0)], 0.01)
    with pytest.raises(ValueError, match="on the axis"):
        lofts.loft(np.array([[0.01, 0], [0.02, 0], [0.02, 0.01], [0, 0.01]]), 12)


def test_rounded_profile_is_tangent_and_loft_has_the_volume_of_the_solid() -> None:
    radius, height, fillet = 0.03, 0.1, 0.01
    corners = [(0, 0, 0), (radius, 0, fillet), (radius, height, fillet), (0, height, 0)]
    mesh = lofts.loft(lofts.rounded_profile(corners, 0.01, 0.02), 360)
    ring = (
        np.pi * (radius - fillet) ** 2 * fillet
        + np.pi**2 / 2 * (radius - fillet) * fillet**2
        + 2 / 3 * np.pi * fillet**3
    )
    assert mesh.volume == pytest.approx(np.pi * radius**2 * (height - 2 * fillet) + 2 * ring, rel=5e-4)


def test_unknown_name_is_refused_with_the_known_ones(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as exit_info:
        generate.main(["teapot", "--out", str(tmp_path / "new")])
    assert exit_info.value.code == 2
    message = capsys.readouterr().err
    assert "teapot" in message
    assert "wine_glass" in message
    assert not (tmp_path / "new").exists()
