import hypothesis
import pytest

from tactopose_drake.core.shape.object_model import ObjectModel
from tests.core.meshes import smooth_shape

# The first call of a compiled kernel takes long; timing is the benchmarks' business.
hypothesis.settings.register_profile("tactopose", deadline=None)
hypothesis.settings.load_profile("tactopose")


@pytest.fixture(scope="session")
def blob() -> ObjectModel:
    """A smooth body without symmetry, some 10 cm long."""
    return ObjectModel.from_mesh(smooth_shape(), symmetry="none")
