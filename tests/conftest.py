import gc
import os

import hypothesis
import pytest

from tactopose_drake.core.shape.object_model import ObjectModel
from tests.core.meshes import smooth_shape

# The first call of a compiled kernel takes long; timing is the benchmarks' business.
hypothesis.settings.register_profile("tactopose", deadline=None)
hypothesis.settings.load_profile("tactopose")


def pytest_configure(config: pytest.Config) -> None:
    """Workers keep all cores busy by themselves: threads of OpenBLAS beside them mostly wait, and burn time by it."""
    if config.getoption("numprocesses", None):
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


def pytest_collection_finish() -> None:
    """What is loaded by now never becomes garbage: a search for some, as each station begins with, leaves it out."""
    gc.freeze()


@pytest.fixture(scope="session")
def blob() -> ObjectModel:
    """A smooth body without symmetry, some 10 cm long."""
    return ObjectModel.from_mesh(smooth_shape(), symmetry="none")
