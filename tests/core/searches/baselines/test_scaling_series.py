import numpy as np

from tactopose_drake.core.poses import exp_so3, identity_poses
from tactopose_drake.core.searches.baselines.region_kernels import mark_first


def test_samples_within_an_earlier_neighbourhood_are_dropped() -> None:
    # Three neighbourhoods of 0.1 rad and 10 mm, two samples each.
    X_region = identity_poses(3)
    X_region[1, 0, 3] = 0.015
    X_region[2, :, :3] = exp_so3(np.array([0.15, 0.0, 0.0]))
    samples = np.repeat(X_region, 2, axis=0)
    samples[2, 0, 3] = 0.009  # Of the second, in the first too.
    samples[4, :, :3] = exp_so3(np.array([0.09, 0.0, 0.0]))  # Of the third, in the first too.
    first = np.empty(6, dtype=np.bool_)
    mark_first(X_region, samples, 2, np.array([0.1, 0.01]), first)
    np.testing.assert_array_equal(first, [True, True, False, True, False, True])


def test_a_wide_neighbourhood_holds_every_rotation() -> None:
    X_region = identity_poses(2)
    samples = identity_poses(2)
    samples[1, :, :3] = exp_so3(np.array([3.1, 0.0, 0.0]))
    first = np.empty(2, dtype=np.bool_)
    mark_first(X_region, samples, 1, np.array([np.pi, 0.01]), first)
    np.testing.assert_array_equal(first, [True, False])
