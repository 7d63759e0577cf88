from pathlib import Path

import numpy as np
import pytest
import trimesh

from tactopose_drake.core.mesh.repair import RepairedMesh
from tactopose_drake.core.shape import model_building, model_cache
from tactopose_drake.core.shape.model_arrays import describe_a_model
from tactopose_drake.core.shape.model_cache import Arrays
from tactopose_drake.core.shape.object_model import ObjectModel
from tests.core.meshes import shape_poor_in_symmetry

SAMPLES = 200
MESH = shape_poor_in_symmetry()


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Arrays:
    with pytest.MonkeyPatch.context() as patch:
        folder = tmp_path_factory.mktemp("cache")
        patch.setenv(model_cache.FOLDER_VARIABLE, str(folder))
        model()
        (path,) = folder.iterdir()
        arrays = model_cache.load(path.stem)
        assert arrays is not None
        return {name: np.array(array) for name, array in arrays.items()}


def model() -> ObjectModel:
    return ObjectModel.from_mesh(MESH, samples=SAMPLES, max_grid_bytes=160_000)


def test_a_kept_model_is_one(kept: Arrays) -> None:
    assert describe_a_model(kept, SAMPLES)
    assert not describe_a_model(kept, SAMPLES + 1)


def test_a_missing_or_further_array_is_noticed(kept: Arrays) -> None:
    for name in kept:
        assert not describe_a_model({key: array for key, array in kept.items() if key != name}, SAMPLES)
    assert not describe_a_model({**kept, "more": np.zeros(3)}, SAMPLES)


def test_a_coarse_field_of_another_grid_is_noticed(kept: Arrays) -> None:
    assert not describe_a_model({**kept, "coarse_values": kept["coarse_values"][:-1]}, SAMPLES)


def test_other_types_and_shapes_are_noticed(kept: Arrays) -> None:
    for name, array in kept.items():
        for other in (array[..., None], array.astype(np.complex64), array.astype(array.dtype.newbyteorder())):
            assert array.dtype.itemsize == 1 or not describe_a_model({**kept, name: other}, SAMPLES), name


CHANGES = {
    "vertices": [np.nan, np.inf, 1e300, 0.1234],
    "faces": [-1, 10**6, 2**31 - 1, -(2**31)],
    "distances": [np.nan, np.inf, -np.inf, 1e30],
    "grid_origin": [np.nan, 1e300, 0.0],
    "grid_spacing": [np.nan, -1.0, 0.0, 1e300, 5e-324],
    "sample_points": [np.nan, 1e300, 5.0],
    "sample_normals": [np.nan, 1e300, 2.0],
    "volume": [np.nan, 0.0, -1.0, 1e300],
    "centroid": [np.nan, 1e300, 1.0],
    "inertia": [np.nan, 0.0, -1e-3, 1e300, 1.0],
    "symmetry_poses": [np.nan, 1e300, 0.0],
    "symmetry_misfits": [np.nan, -1e-3, 1e300],
    "likenesses": [np.nan, 1e300, 0.0],
    "repairs": [0, 255],
    "content_hash": [0],
}


@pytest.mark.parametrize(("name", "value"), [(name, value) for name, values in CHANGES.items() for value in values])
def test_numbers_that_no_model_has_are_noticed(kept: Arrays, name: str, value: float) -> None:
    array = kept[name].copy()
    array.reshape(-1)[0] = value
    assert not describe_a_model({**kept, name: array}, SAMPLES)


def test_a_signed_file_that_holds_no_model_is_built_anew(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kept: Arrays
) -> None:
    monkeypatch.setenv(model_cache.FOLDER_VARIABLE, str(tmp_path))
    built = model()
    (path,) = tmp_path.iterdir()
    content = path.read_bytes()
    faces = kept["faces"].copy()
    faces[3, 1] = len(kept["vertices"])
    model_cache.store(path.stem, {**kept, "faces": faces})
    assert path.read_bytes() != content
    np.testing.assert_array_equal(model().faces, built.faces)
    assert path.read_bytes() == content

    def fail(*_: object) -> RepairedMesh:
        raise AssertionError("built anew")

    monkeypatch.setattr(model_building, "repair_mesh", fail)
    np.testing.assert_array_equal(model().faces, built.faces)


def test_near_axes_are_directions(kept: Arrays) -> None:
    assert describe_a_model({**kept, "near_axes": np.array([[0.0, 0.6, 0.8]])}, SAMPLES)
    for wrong in ([[0.0, 0.6, 0.7]], [[np.nan, 0.0, 0.0]]):
        assert not describe_a_model({**kept, "near_axes": np.array(wrong)}, SAMPLES)


def test_a_turn_may_move_the_origin_of_a_far_object_by_twice_its_distance(tmp_path: Path, monkeypatch) -> None:
    """As a half turn does whose axis runs across the way to the object, and that may be longer than each coordinate."""
    monkeypatch.setenv(model_cache.FOLDER_VARIABLE, str(tmp_path))
    centre = np.full(3, 0.7)
    box = trimesh.creation.box((0.06, 0.05, 0.04))
    # One of its axes turns the centre onto -z.
    axis = centre / np.linalg.norm(centre) - [0.0, 0.0, 1.0]
    box.apply_transform(trimesh.geometry.align_vectors([1.0, 0.0, 0.0], axis / np.linalg.norm(axis)))
    box.apply_translation(centre)
    far = ObjectModel.from_mesh(box, samples=1000, max_grid_bytes=2**21)
    assert np.abs(far.symmetry_poses[:, :, 3]).max() > 2.5 * 0.7
    (path,) = tmp_path.iterdir()
    arrays = model_cache.load(path.stem)
    assert arrays is not None
    assert describe_a_model(arrays, 1000)
