"""Models of meshes in any unit, of simple bodies, and of meshes far from their origin."""

import math
from pathlib import Path

import numpy as np
import pytest
import trimesh

from tactopose_drake.core.mesh.repair import MeshRepairWarning
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.errors import InvalidInputError, MeshUnitsError


@pytest.fixture
def in_millimetres(tmp_path: Path) -> Path:
    path = tmp_path / "block.stl"
    trimesh.creation.box((40.0, 60.0, 100.0)).export(path)
    return path


def test_a_mesh_in_millimetres_is_scaled(in_millimetres: Path) -> None:
    with pytest.raises(
        MeshUnitsError, match=r"by 0\.001 if it is in millimetres: `scale=`, `--scale`, or `scale:` in a library"
    ):
        ObjectModel.from_mesh(in_millimetres, cache=False)
    model = ObjectModel.from_mesh(in_millimetres, scale=0.001, cache=False)
    np.testing.assert_allclose(np.ptp(model.vertices, axis=0), [0.04, 0.06, 0.1], atol=1e-9)
    assert model.volume == pytest.approx(0.04 * 0.06 * 0.1)


def test_the_cache_tells_scales_apart(in_millimetres: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TACTOPOSE_CACHE_DIR", str(tmp_path / "cache"))
    sizes = [ObjectModel.from_mesh(in_millimetres, scale=scale).size for scale in (0.001, 0.0005, 0.001)]
    np.testing.assert_allclose(sizes, 0.001 * np.linalg.norm([40.0, 60.0, 100.0]) * np.array([1.0, 0.5, 1.0]))


@pytest.mark.parametrize("scale", [0.0, -1.0, math.nan, 1e9])
def test_an_impossible_scale_is_refused(in_millimetres: Path, scale: float) -> None:
    with pytest.raises(InvalidInputError, match=r"scale must be .*, not"):
        ObjectModel.from_mesh(in_millimetres, scale=scale)


def test_simple_bodies_have_their_volumes_and_symmetries() -> None:
    box = ObjectModel.from_box([0.04, 0.06, 0.1], cache=False)
    assert box.name == "box"
    assert box.volume == pytest.approx(0.04 * 0.06 * 0.1)
    assert len(box.symmetry_poses) == 4
    cylinder = ObjectModel.from_cylinder(0.03, 0.12, mass=0.2, cache=False)
    assert cylinder.mass == 0.2
    assert cylinder.volume == pytest.approx(math.pi * 0.03**2 * 0.12, rel=2e-3)
    assert any(symmetry.is_continuous and abs(symmetry.axis[2]) > 0.999 for symmetry in cylinder.symmetries)
    sphere = ObjectModel.from_sphere(0.04, name="ball", cache=False)
    assert sphere.name == "ball"
    assert sphere.volume == pytest.approx(4 / 3 * math.pi * 0.04**3, rel=5e-3)
    capsule = ObjectModel.from_capsule(0.02, 0.05, cache=False)
    np.testing.assert_allclose(np.ptp(capsule.vertices, axis=0), [0.04, 0.04, 0.09], atol=1e-4)
    np.testing.assert_allclose(capsule.middle, 0.0, atol=1e-9)
    with pytest.raises(InvalidInputError, match=r"radius must be .*, not -1"):
        ObjectModel.from_sphere(-1.0)


def test_a_model_about_its_middle_is_the_same_body() -> None:
    offset = np.array([0.7, -0.2, 0.4])
    mesh = trimesh.creation.cylinder(radius=0.03, height=0.12, sections=64)
    mesh.apply_translation(offset)
    model = ObjectModel.from_mesh(mesh, cache=False)
    moved = model.about_middle
    np.testing.assert_allclose(model.middle, offset, atol=1e-9)
    p_CQ = np.random.default_rng(0).uniform(-0.05, 0.05, (20, 3))
    np.testing.assert_allclose(moved.grid.distance(p_CQ), model.grid.distance(p_CQ + offset), atol=1e-9)
    np.testing.assert_allclose(moved.center_of_mass, 0.0, atol=1e-6)
    for pose in moved.symmetry_poses:
        np.testing.assert_allclose(pose[:, 3], 0.0, atol=1e-3)


def test_no_warning_for_a_scaled_mesh(in_millimetres: Path, recwarn: pytest.WarningsRecorder) -> None:
    ObjectModel.from_mesh(in_millimetres, scale=0.001, cache=False)
    assert not [warning for warning in recwarn if issubclass(warning.category, MeshRepairWarning)]
