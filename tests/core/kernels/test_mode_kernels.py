import numpy as np
import pytest

from tactopose_drake.core.kernels import mode_kernels
from tactopose_drake.core.poses import compose, increments_between, make_poses, random_rotations, retract
from tactopose_drake.core.shape.symmetry import RotationalSymmetry, symmetry_group


@pytest.mark.parametrize("wide", [0.02, 0.3, 3.0])
def test_modes_are_told_apart_by_their_distance_alone(wide: float) -> None:
    generator = np.random.default_rng(0)
    symmetries = symmetry_group([RotationalSymmetry(np.array([0.0, 0.0, 1.0]), np.array([0.01, 0.0, 0.0]), 4)])
    places = make_poses(random_rotations(generator, 5), 0.05 * generator.normal(size=(5, 3)))
    X_PO = retract(places[generator.integers(5, size=60)], generator.normal(size=(60, 6)) * np.repeat([wide, 0.003], 3))
    root = generator.normal(size=(60, 6, 6)) / np.repeat([wide, 0.003], 3)[:, None]
    information = root @ np.swapaxes(root, 1, 2)
    marked = np.empty(60, dtype=np.bool_)
    mode_kernels.mark_distinct(X_PO, information, symmetries, 9.0, marked)
    distinct: list[int] = []
    for b in range(60):
        images = compose(X_PO[b][None], symmetries)
        u = [increments_between(X_PO[a][None], images) for a in distinct]
        if all(np.einsum("si,ij,sj->s", v, information[a], v).min() >= 9.0 for a, v in zip(distinct, u, strict=True)):
            distinct.append(b)
    assert np.flatnonzero(marked).tolist() == distinct
    assert 5 < len(distinct) < 60
