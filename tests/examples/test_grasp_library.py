import importlib
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

import tactopose_drake as tp

FOLDER = Path(__file__).parents[2] / "examples" / "thesis"


@pytest.fixture(scope="module")
def library() -> Iterator[ModuleType]:
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(FOLDER))
        yield importlib.import_module("grasp_library")  # The path stays for the process that simulates.


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("grasps") / "new"


@pytest.fixture(scope="module")
def grasp(library: ModuleType, folder: Path) -> Any:
    """One simulated grasp of the wine glass."""
    (grasp,) = library.make_library("wine_glass", 1, folder)
    return grasp


def in_object(grasp: Any, p_PQ: np.ndarray) -> np.ndarray:
    return (p_PQ - grasp.X_PO[:, 3]) @ grasp.X_PO[:, :3]


def test_five_fingertips_touch_the_surface_and_carry(library: ModuleType, grasp: Any) -> None:
    model = tp.ObjectModel.from_mesh(library.make_scenario("wine_glass").object_mesh())
    distance, n_O = model.grid.distance_and_normal(in_object(grasp, grasp.p_PC))
    assert distance.shape == (5,)
    assert np.all(np.abs(distance) < 0.0005)
    assert np.all(np.einsum("ki,ki->k", grasp.n_PC @ grasp.X_PO[:, :3], n_O) > np.cos(np.radians(10)))
    # The object pushes the fingertips outwards, within the cone of friction of the simulation.
    assert np.all(np.einsum("ki,ki->k", grasp.f_PC, grasp.n_PC) > 0.5)
    assert np.all(np.linalg.norm(grasp.f_PC, axis=1) >= 1.0)


def test_the_hand_is_where_the_contacts_are_and_not_in_the_object(library: ModuleType, grasp: Any) -> None:
    model = tp.ObjectModel.from_mesh(library.make_scenario("wine_glass").object_mesh())
    depth = grasp.radius - model.grid.distance(in_object(grasp, grasp.p_PH))
    assert depth.max() < 0.002
    to_contacts = np.linalg.norm(grasp.p_PH - grasp.p_PC[:, None], axis=2) - grasp.radius
    assert np.all(to_contacts.min(axis=1) < 0.001)


def test_the_little_finger_touches_the_stem(grasp: Any) -> None:
    x, y, z = in_object(grasp, grasp.p_PC[4])
    assert np.hypot(x, y) < 0.01
    assert 0.015 < z < 0.09


def test_two_processes_may_write_the_same_grasp(
    library: ModuleType, tmp_path: Path, grasp: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, save, written = tmp_path / "grasp.npz", np.savez, []

    def save_while_another_does(file: Any, **arrays: Any) -> None:
        if not written:
            written.append(path)
            with monkeypatch.context() as patch:
                patch.setattr(library.os, "getpid", lambda: -1)
                library._save(path, grasp)
        save(file, **arrays)

    monkeypatch.setattr(library.np, "savez", save_while_another_does)
    library._save(path, grasp)
    assert list(tmp_path.iterdir()) == [path]
    with np.load(path) as arrays:
        np.testing.assert_array_equal(arrays["X_PO"], grasp.X_PO)


def test_what_is_there_is_not_simulated_again(
    library: ModuleType, folder: Path, grasp: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    seeds = []

    def simulate(name: str, seed: int) -> Any:
        seeds.append(seed)
        return None if len(seeds) == 1 else grasp

    monkeypatch.setattr(library, "simulate", simulate)
    monkeypatch.setattr(library, "ProcessPoolExecutor", lambda *_, **__: ThreadPoolExecutor(1))
    before = len(list(folder.iterdir()))
    (again,) = library.make_library("wine_glass", 1, folder)
    assert not seeds
    for name, values in vars(grasp).items():
        np.testing.assert_array_equal(getattr(again, name), values)
    # A seed without a grasp is passed over, now and later.
    assert len(library.make_library("wine_glass", 2, folder)) == 2
    assert seeds == [before, before + 1]
    assert len(library.make_library("wine_glass", 2, folder)) == 2
    assert seeds == [before, before + 1]


@pytest.mark.parametrize(
    ("name", "point", "wanted"),
    [
        ("wine_glass", (0.004, 0.0, 0.05), True),
        ("wine_glass", (0.03, 0.0, 0.05), False),
        ("wine_glass", (0.004, 0.0, 0.0), False),
        ("bust", (0.03, 0.0, 0.05), True),
    ],
)
def test_only_of_the_glass_the_little_finger_must_be_on_the_stem(
    library: ModuleType, name: str, point: tuple[float, float, float], wanted: bool
) -> None:
    R, p = np.eye(3)[[1, 2, 0]], np.array([0.1, 0.2, 0.3])
    assert library.is_wanted(name, np.column_stack([R, p]), R @ point + p) is wanted
