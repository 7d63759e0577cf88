import numpy as np

from tactopose_drake.core.evidence.hand_geometry import HandGeometry
from tactopose_drake.core.poses import exp_so3, identity_poses
from tactopose_drake.core.searches.baselines.hand_clearance import HandClearance


def test_points_near_the_middle_of_a_sphere_collide() -> None:
    # A point of the object, 0.1 m along its x; a hand of two spheres along P's y.
    hand = HandGeometry(np.array([[0.0, 0.1, 0.0], [0.0, -0.1, 0.0]]), np.array([0.02, 0.01]))
    X_PO = identity_poses(5)
    X_PO[1:, :, :3] = exp_so3(np.array([0.0, 0.0, 0.5 * np.pi]))
    X_PO[4, :, :3] = X_PO[4, :, :3].T
    X_PO[2, :, 3] = [0.0, 0.0, 0.009]
    X_PO[3, :, 3] = [0.0, 0.0, 0.011]
    clear = HandClearance(np.array([[0.1, 0.0, 0.0]]), hand)(X_PO)
    np.testing.assert_array_equal(clear, [True, False, False, True, False])
