from pathlib import Path

import pytest

from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.resources import model_path
from tests.cli.test_cli import run as tactopose
from tests.drivers.test_driver_contract import open_files
from tests.runs.cube_grasp import write_grasp
from tests.runs.stations import bus_threads


@pytest.fixture(scope="session")
def cube() -> ObjectModel:
    return ObjectModel.from_mesh(model_path("objects", "cube.obj"))


@pytest.fixture(scope="session")
def can() -> ObjectModel:
    return ObjectModel.from_mesh(model_path("objects", "soda_can.obj"))


@pytest.fixture(scope="session")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where `cube.scenario.yaml` is."""
    folder = tmp_path_factory.mktemp("run")
    write_grasp(folder)
    return folder


@pytest.fixture(scope="session")
def recording(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of that scenario, recorded by the command line."""
    files = open_files()
    recording = tmp_path_factory.mktemp("recordings") / "grasp"
    assert tactopose("run", folder / "cube.scenario.yaml", "--record", recording, "--monitor") == 0
    assert bus_threads() == set()
    # A model's arrays stay mapped from the cache, also where another process has put the same file in its place since.
    assert {name for name in open_files() - files if not name.removesuffix(" (deleted)").endswith(".npy")} == set()
    return recording
