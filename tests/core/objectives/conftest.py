import pytest
import trimesh

from tactopose_drake.core.shape.object_model import ObjectModel
from tests.core.meshes import shape_poor_in_symmetry


@pytest.fixture(scope="session")
def angular() -> ObjectModel:
    return ObjectModel.from_mesh(shape_poor_in_symmetry())


@pytest.fixture(scope="session")
def slab() -> ObjectModel:
    """Below z = 0, and wide."""
    mesh = trimesh.creation.box((0.2, 0.2, 0.05))
    mesh.apply_translation([0.0, 0.0, -0.025])
    return ObjectModel.from_mesh(mesh)
