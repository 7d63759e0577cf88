import numpy as np

from tactopose_drake.core.tracking.contact_update import ContactUpdate
from tactopose_drake.core.tracking.mode_set import ModeSet
from tactopose_drake.core.tracking.surprise import is_surprised, watch

P = np.diag(np.repeat([1e-4, 1e-6], 3))[None]


def make_modes() -> ModeSet:
    return ModeSet.make(np.eye(3, 4)[None], P, np.zeros((1, 6, 6)), np.zeros((1, 1, 2)), np.zeros(1), np.zeros(1))


def update(step: np.ndarray, misfit: float = 3.0) -> ContactUpdate:
    """One that halves the covariance, and moves the pose."""
    X_PO = np.eye(3, 4)[None].copy()
    X_PO[0, :, 3] = step
    return ContactUpdate(X_PO, 0.5 * P, np.zeros((1, 6, 6)), np.zeros(1), np.array([misfit]), np.zeros((1, 1, 2)), 0.5)


def test_corrections_all_one_way_are_a_slip_and_those_to_and_fro_are_none() -> None:
    for sign, slips in ((1.0, True), (-1.0, False)):
        modes, step = make_modes(), np.array([0.0006, 0.0, 0.0])
        for _ in range(20):
            # Each prediction is where the last one was.
            modes = watch(modes, update(step), 3)
            modes = ModeSet(np.eye(3, 4)[None], P, *list(vars(modes).values())[2:])
            step = sign * step
        assert is_surprised(modes)[0] == slips


def test_a_touch_that_is_off_by_more_than_noise_is_a_surprise() -> None:
    modes = make_modes()
    for _ in range(5):
        modes = watch(modes, update(np.zeros(3), 40.0), 3)
    assert is_surprised(modes)[0]


def test_a_direction_that_seems_to_have_shrunk_is_no_surprise() -> None:
    """Tangent spaces turn from frame to frame, by which a narrow direction seems to widen: then nothing is expected."""
    modes = make_modes()
    for i in range(20):
        wider = update(np.array([1e-5 * (-1.0) ** i, 0.0, 0.0]))._replace(covariance=1.5 * P)
        modes = watch(modes, wider, 3)
        modes = ModeSet(np.eye(3, 4)[None], P, *list(vars(modes).values())[2:])
    assert not is_surprised(modes)[0]
