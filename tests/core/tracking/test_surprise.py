import numpy as np

from tactopose_drake.core.tracking.contact_update import ContactUpdate
from tactopose_drake.core.tracking.mode_set import ModeSet
from tactopose_drake.core.tracking.surprise import is_surprised, watch

P = np.diag(np.repeat([1e-4, 1e-6], 3))[None]


def make_modes() -> ModeSet:
    return ModeSet.make(np.eye(3, 4)[None], P, np.zeros((1, 6, 6)), np.zeros((1, 1, 2)), np.zeros(1), np.zeros(1))


def update(step: np.ndarray, log_evidence: float, stays: float, misfit: float = 3.0) -> ContactUpdate:
    """One that halves the covariance, and moves the pose."""
    X_PO = np.eye(3, 4)[None].copy()
    X_PO[0, :, 3] = step
    evidence = np.array([log_evidence])
    return ContactUpdate(X_PO, 0.5 * P, np.zeros((1, 6, 6)), evidence, np.array([misfit]), np.zeros((1, 1, 2)), stays)


def test_evidence_that_stays_counts_no_more_than_the_share_that_is_new_allows() -> None:
    modes = make_modes()
    for _ in range(200):
        modes = watch(modes, update(np.zeros(3), -2.0, 0.25), 3)
    np.testing.assert_allclose(modes.log_weight, -2.0 / 0.25)


def test_corrections_all_one_way_are_a_slip_and_those_to_and_fro_are_none() -> None:
    for sign, slips in ((1.0, True), (-1.0, False)):
        modes, step = make_modes(), np.array([0.0006, 0.0, 0.0])
        for _ in range(20):
            # Each prediction is where the last one was.
            modes = watch(modes, update(step, 0.0, 0.5), 3)
            modes = ModeSet(np.eye(3, 4)[None], P, *list(vars(modes).values())[2:])
            step = sign * step
        assert is_surprised(modes)[0] == slips


def test_a_touch_that_is_off_by_more_than_noise_is_a_surprise() -> None:
    modes = make_modes()
    for _ in range(5):
        modes = watch(modes, update(np.zeros(3), 0.0, 0.5, 40.0), 3)
    assert is_surprised(modes)[0]
