"""Models that tests of several files share, each built once for each process, for a model never changes.

None is taken from the cache on disk: what builds it may have changed since.
"""

import functools

import trimesh

from tactopose_drake.core.shape.object_model import ObjectModel


@functools.cache
def brick(x: float, y: float, z: float) -> ObjectModel:
    """A box of these sides, m, with its symmetries."""
    return ObjectModel.from_mesh(trimesh.creation.box((x, y, z)), cache=False)


@functools.cache
def globe(radius: float, subdivisions: int = 3) -> ObjectModel:
    """A ball, with its symmetries."""
    return ObjectModel.from_mesh(trimesh.creation.icosphere(subdivisions=subdivisions, radius=radius), cache=False)
