import numpy as np

from tactopose_drake.core.calibration.mixture_loss import CONTACT_LIMIT, grasp_limit, loss, weight


def test_the_loss_is_the_square_until_its_limit() -> None:
    square = np.array([0.0, 1.0, 4.0, 200.0, 1e6])
    np.testing.assert_allclose(loss(square, CONTACT_LIMIT), [0.0, 1.0, 4.0, CONTACT_LIMIT, CONTACT_LIMIT], atol=0.01)


def test_the_weight_is_the_derivative_of_the_loss() -> None:
    square, step = np.linspace(0.0, 40.0, 50), 1e-4
    difference = (loss(square + step, CONTACT_LIMIT) - loss(square - step, CONTACT_LIMIT)) / (2.0 * step)
    np.testing.assert_allclose(difference, weight(square, CONTACT_LIMIT), atol=1e-6)


def test_a_grasp_of_more_contacts_may_cost_more() -> None:
    limit = grasp_limit(np.array([3, 4, 5]))
    assert np.all(np.diff(limit) > 3.0)
    assert np.all(limit > CONTACT_LIMIT)
