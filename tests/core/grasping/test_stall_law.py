import numpy as np

from tactopose_drake.core.grasping.stall_law import close_until_stalled

NOT_YET = np.zeros(3, dtype=bool)


def test_a_free_motor_moves_on_and_a_blocked_one_stays_where_it_is() -> None:
    commanded, stalled = close_until_stalled(
        np.array([0.5, 0.5, 0.5]), np.array([0.5, 0.485, 0.47]), NOT_YET, step=0.01, reach=0.02
    )
    np.testing.assert_allclose(commanded, [0.51, 0.51, 0.5])
    np.testing.assert_array_equal(stalled, [False, False, True])


def test_a_motor_waits_while_its_joint_is_unknown() -> None:
    commanded, stalled = np.array([0.5, np.nan, 0.5]), NOT_YET
    for measured in ([0.5, np.nan, np.nan], [0.5, np.nan, np.nan], [0.5, 0.3, 0.4]):
        commanded, stalled = close_until_stalled(commanded, np.array(measured), stalled, step=0.01, reach=0.05)
    np.testing.assert_allclose(commanded, [0.53, 0.31, 0.5])
    np.testing.assert_array_equal(stalled, [False, False, True])


def test_a_motor_that_has_stalled_holds_though_its_joint_gives_way() -> None:
    commanded, stalled = np.array([0.5, 0.5, 0.5]), np.array([True, False, True])
    for measured in (0.4, 0.5, 0.7):
        commanded, stalled = close_until_stalled(commanded, np.full(3, measured), stalled, step=0.01, reach=1.0)
    np.testing.assert_allclose(commanded, [0.5, 0.53, 0.5])
    np.testing.assert_array_equal(stalled, [True, False, True])
