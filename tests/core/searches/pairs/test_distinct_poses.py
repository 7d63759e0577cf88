import numpy as np

from tactopose_drake.core.poses import make_poses, random_rotations
from tactopose_drake.core.searches.pairs.distinct_kernels import distinct_poses


def test_of_poses_close_together_the_first_is_kept() -> None:
    generator = np.random.default_rng(0)
    far = make_poses(random_rotations(generator, 50), generator.normal(size=(50, 3)))
    assert distinct_poses(far, 0.004, 0.1).all()
    twice = np.concatenate([far, far + 1e-12])
    kept = distinct_poses(twice, 0.004, 0.1)
    assert kept[:50].all()
    assert kept[50:].sum() <= 2
    assert len(distinct_poses(far[:0], 0.004, 0.1)) == 0
