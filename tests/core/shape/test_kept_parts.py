"""Parts of models on disk: the same bits as when they are made, and no file is believed."""

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tactopose_drake.core.shape import kept_parts, model_cache
from tactopose_drake.core.shape.model_cache import Arrays
from tactopose_drake.core.shape.object_model import ObjectModel
from tests.core.meshes import shape_poor_in_symmetry

MESH = shape_poor_in_symmetry()


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv(model_cache.FOLDER_VARIABLE, str(tmp_path))
    return tmp_path


def model(cache: bool = True) -> ObjectModel:
    return ObjectModel.from_mesh(MESH, samples=200, max_grid_bytes=160_000, cache=cache)


PARTS: dict[str, Callable[[ObjectModel], Any]] = {
    "build_pair_features": lambda model: model.pair_features,
    "make_surfels": lambda model: model.surfels(0.002),
}


def assert_same(a: Any, b: Any) -> None:
    for field in dataclasses.fields(a):
        np.testing.assert_array_equal(getattr(a, field.name), getattr(b, field.name), err_msg=field.name)


@pytest.fixture(params=list(PARTS))
def made(request: pytest.FixtureRequest, folder: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[str, Any, Path]:
    """What makes a part, the part, and its file."""
    of_model = model()
    (before,) = folder.iterdir()
    part = PARTS[request.param](of_model)
    (path,) = set(folder.iterdir()) - {before}
    return request.param, part, path


def forbid(monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    def fail(*_: object) -> None:
        raise AssertionError("made anew")

    monkeypatch.setattr(kept_parts, name, fail)


def test_the_second_model_takes_what_the_first_has_made(made: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    name, part, _ = made
    forbid(monkeypatch, name)
    found = PARTS[name](model())
    assert_same(found, part)
    for field in dataclasses.fields(found):
        value = getattr(found, field.name)
        assert not isinstance(value, np.ndarray) or not value.flags.writeable


def test_a_damaged_part_is_made_anew(made: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    name, part, path = made
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 0x10
    path.write_bytes(content)
    assert_same(PARTS[name](model()), part)
    forbid(monkeypatch, name)
    assert_same(PARTS[name](model()), part)


def changes(arrays: Arrays) -> list[Arrays]:
    """Each array in turn with a number that it cannot hold, shortened, and of another type."""
    changed = []
    for name, array in arrays.items():
        if name not in ("features", "normals", "points", "origin", "spacing"):
            other = array.copy()
            other.reshape(-1)[-1] = np.nan if array.dtype.kind == "f" else 30_000
            changed.append({**arrays, name: other})
        if array.ndim:
            changed.append({**arrays, name: array[:-1]})
        changed.append({**arrays, name: array.astype(np.complex64)})
    return [*changed, {key: arrays[key] for key in list(arrays)[1:]}]


def test_a_signed_file_that_holds_no_such_part_is_made_anew(made: Any) -> None:
    name, part, path = made
    kept = model_cache.load(path.stem)
    assert kept is not None
    kept = {key: np.array(array) for key, array in kept.items()}
    for arrays in changes(kept):
        model_cache.store(path.stem, arrays)
        assert_same(PARTS[name](model()), part)


def test_without_the_cache_nothing_is_kept(folder: Path) -> None:
    for part in PARTS.values():
        part(model(cache=False))
    assert list(folder.iterdir()) == []


def test_a_model_that_is_ready_has_all_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    ready = model()
    ready.make_ready()
    for name in PARTS:
        forbid(monkeypatch, name)
    for part in PARTS.values():
        part(ready)
    for sigma in np.geomspace(0.0005, 0.02, 50):
        ready.surfels(sigma)
    assert "unevenness" in vars(ready), "the first touch would wait for it"


def test_a_model_from_the_cache_has_at_once_what_an_estimate_left_there(monkeypatch: pytest.MonkeyPatch) -> None:
    first = model()
    first.make_ready()
    again = model()

    def fail(key: str) -> None:
        raise AssertionError("read later")

    monkeypatch.setattr(model_cache, "load", fail)
    assert_same(again.pair_features, first.pair_features)
    assert_same(again.surfels(0.0009), first.surfels(0.0009))


def test_a_model_of_which_nothing_is_kept_is_made_without_its_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in PARTS:
        forbid(monkeypatch, name)
    for _ in range(2):  # The second is from the cache.
        assert "pair_features" not in vars(model())
