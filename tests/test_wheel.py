"""What an installed package consists of, and that it finds its models without the checkout."""

import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest
from hatchling.build import build_wheel

CHECKOUT = Path(__file__).parents[1]

USE = """
from pathlib import Path
import tactopose_drake
from tactopose_drake.hand import load_hand_config, make_hand_plant
from tactopose_drake.resources import model_path
from tactopose_drake.station import load_scenario
from tactopose_drake.systems import load_force_torque_model

plant, hand = make_hand_plant(load_hand_config("shadow_like"))
load_force_torque_model()
print(Path(tactopose_drake.__file__).parent)
print(model_path("objects", "mug.obj"))
print(load_scenario("shadow_like").object_mesh())
print(len(hand.fingers))
"""


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A wheel, built from the checkout by the backend that pip uses."""
    folder = tmp_path_factory.mktemp("wheel")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(CHECKOUT)
        return folder / build_wheel(str(folder))


def contents(wheel: Path) -> list[str]:
    with zipfile.ZipFile(wheel) as archive:
        return archive.namelist()


def test_models_and_diagrams_are_in_it(wheel: Path) -> None:
    shipped = {
        path.relative_to(CHECKOUT).as_posix()
        for folder in ("models", "diagrams")
        for path in (CHECKOUT / folder).rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    }
    assert "models/objects/mug.sdf" in shipped
    assert {f"tactopose_drake/{path}" for path in shipped} <= set(contents(wheel))


def test_stubs_that_the_faces_are_made_of_are_in_it(wheel: Path) -> None:
    stubs = {path.relative_to(CHECKOUT).as_posix() for path in (CHECKOUT / "tactopose_drake").rglob("*.pyi")}
    assert "tactopose_drake/core/searches/__init__.pyi" in stubs
    assert stubs <= set(contents(wheel))


def test_nothing_but_the_package_is_in_it(wheel: Path) -> None:
    names = contents(wheel)
    assert {name.split("/")[0].split("-")[0] for name in names} == {"tactopose_drake"}
    assert "tactopose_drake/py.typed" in names
    assert not [name for name in names if "__pycache__" in name or "tests" in name.split("/")]


def test_installed_it_finds_its_files(wheel: Path, tmp_path: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(tmp_path / "site")
    environment = {**os.environ, "PYTHONPATH": str(tmp_path / "site")}
    done = subprocess.run(
        [sys.executable, "-c", USE], cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    package, mesh, scenario_mesh, fingers = done.stdout.splitlines()
    installed = tmp_path / "site" / "tactopose_drake"
    assert Path(package) == installed
    for path in (mesh, scenario_mesh):
        assert Path(path).is_relative_to(installed)
        assert Path(path).is_file()
    assert fingers == "5"
