import logging
from pathlib import Path

import numpy as np
import pytest
import trimesh

from tactopose_drake.core.poses import make_poses
from tactopose_drake.core.shape import model_cache
from tactopose_drake.core.shape.model_symmetries import misfits
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.shape.symmetry import RotationalSymmetry
from tests.core.meshes import create, scanned_can

BOX = create.box((0.05, 0.08, 0.12))


@pytest.fixture(autouse=True)
def cache_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(model_cache.FOLDER_VARIABLE, str(tmp_path / "cache"))


def model_of(mesh: trimesh.Trimesh, **options: object) -> ObjectModel:
    return ObjectModel.from_mesh(mesh, max_grid_bytes=3_200_000, **options)  # type: ignore[arg-type]


def test_symmetry_may_be_given_or_left_out() -> None:
    assert model_of(BOX, symmetry="none").symmetries == ()
    assert len(model_of(BOX, symmetry="none").symmetry_poses) == 1
    turn = RotationalSymmetry(np.array([0.0, 0.0, 1.0]), np.zeros(3), 4)
    given = model_of(BOX, symmetry=[turn])
    assert given.symmetries == (turn,)
    assert len(given.symmetry_poses) == 4
    assert len(model_of(BOX).symmetry_poses) == 4  # detected: the box's own four


def test_a_told_symmetry_whose_axis_is_beside_the_object_is_taken_but_said(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(logging.getLogger("tactopose_drake"), "filters", [])  # The command line says things once.
    in_a_corner = BOX.copy().apply_translation([0.025, 0.04, 0.06])
    model_of(in_a_corner, symmetry=[RotationalSymmetry(np.array([0.0, 0.0, 1.0]), np.array([0.025, 0.04, 0.0]), 2)])
    assert not caplog.records
    model = model_of(in_a_corner, symmetry=[RotationalSymmetry(np.array([0.0, 0.0, 1.0]), np.zeros(3), 2)])
    assert len(model.symmetry_poses) == 2
    (record,) = caplog.records
    assert "symmetry[0] is taken as told, though its turns leave the surface off by up to" in record.getMessage()


def test_misfits_are_root_mean_squares() -> None:
    ball = model_of(trimesh.creation.icosphere(4, 0.04))
    moved = make_poses(np.tile(np.eye(3), (2, 1, 1)), np.array([[0.0, 0.0, 0.0], [0.003, 0.0, 0.0]]))
    # A ball's surface that moves by d is off by d times a cosine, whose mean square is a third.
    off = misfits(ball.grid, ball.samples, moved)
    np.testing.assert_allclose(off, [0.0, 0.003 / np.sqrt(3.0)], rtol=0.03, atol=5e-5)


def test_near_symmetry_is_said_unless_symmetries_are_told(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(logging.getLogger("tactopose_drake"), "filters", [])  # The command line says things once.
    mesh = scanned_can().apply_translation([0.03, 0.0, 0.2])
    for _ in ("built", "from the cache"):
        model = model_of(mesh, name="soup")
        (near,) = model.near_symmetries
        np.testing.assert_allclose(near.point, model.center_of_mass, atol=1e-9)
        np.testing.assert_allclose(model.about_middle.near_symmetries[0].point, near.point - model.middle, atol=1e-9)
        assert "nearly any-fold" in repr(model)
        (record,) = caplog.records
        assert record.getMessage().startswith("soup: is nearly unchanged by turns about its z axis (surface off by up")
        assert "--symmetry z" in record.getMessage()
        caplog.clear()
    turn = RotationalSymmetry(np.array([0.0, 0.0, 1.0]), mesh.center_mass, 0)
    for told in ("none", [turn], []):
        model = model_of(mesh, symmetry=told)
        assert model.near_symmetries == ()
        assert model.symmetries_are_given == (told != "none")
    assert model_of(BOX).near_symmetries == ()
    assert not caplog.records
