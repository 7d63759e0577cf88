import pytest

from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.resources import model_path


@pytest.fixture(scope="session")
def cube() -> ObjectModel:
    return ObjectModel.from_mesh(model_path("objects", "cube.obj"))


@pytest.fixture(scope="session")
def can() -> ObjectModel:
    return ObjectModel.from_mesh(model_path("objects", "soda_can.obj"))
