import numpy as np

from tactopose_drake.core.grasping.held_pose import least_distance, shifted_off
from tactopose_drake.core.poses import exp_so3, make_poses
from tactopose_drake.core.shape.object_model import ObjectModel


def test_an_object_in_the_palm_is_shifted_off_it(blob: ObjectModel) -> None:
    x, y = (axis.ravel() for axis in np.meshgrid(np.linspace(-0.06, 0.06, 13), np.linspace(-0.06, 0.06, 13)))
    palm = np.column_stack([x, y, np.zeros(len(x))]), np.full(len(x), 0.01)
    X_PO = make_poses(exp_so3(np.array([0.4, -0.3, 1.0])), np.array([0.01, 0.0, 0.02]))
    assert least_distance(blob, X_PO, palm) < -0.005
    shifted = shifted_off(blob, X_PO, palm, 0.004)
    assert least_distance(blob, shifted, palm) >= 0.004
    np.testing.assert_array_equal(shifted[:, :3], X_PO[:, :3])
    # Away from the palm, and no farther than it must be.
    assert shifted[2, 3] > X_PO[2, 3]
    assert least_distance(blob, shifted, palm) < 0.006


def test_an_object_off_the_palm_stays_where_it_is(blob: ObjectModel) -> None:
    X_PO = make_poses(np.eye(3), np.array([0.0, 0.0, 0.3]))
    np.testing.assert_array_equal(shifted_off(blob, X_PO, (np.zeros((1, 3)), np.full(1, 0.01)), 0.004), X_PO)
