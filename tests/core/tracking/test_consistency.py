import numpy as np

from tactopose_drake.core.tracking.consistency import are_inconsistent, record_innovations
from tactopose_drake.core.tracking.contact_update import ContactUpdate
from tactopose_drake.core.tracking.tracked_modes import TrackedModes
from tactopose_drake.core.tracking.tracker_params import ConsistencyParams

PARAMS = ConsistencyParams()
P = np.diag(np.repeat([1e-4, 1e-6], 3))[None]


def make_modes() -> TrackedModes:
    return TrackedModes.independent(np.eye(3, 4)[None], P, 1)


def update(step: np.ndarray, nis: float = 3.0) -> ContactUpdate:
    """One that halves the covariance, and moves the pose."""
    X_PO = np.eye(3, 4)[None].copy()
    X_PO[0, :, 3] = step
    return ContactUpdate(X_PO, 0.5 * P, np.zeros((1, 6, 6)), np.array([nis]), np.zeros((1, 1, 2)))


def test_corrections_all_one_way_are_a_slip_and_those_to_and_fro_are_none() -> None:
    for sign, slips in ((1.0, True), (-1.0, False)):
        modes, step = make_modes(), np.array([0.0009, 0.0, 0.0])
        for _ in range(20):
            # Each prediction is where the last one was.
            modes = record_innovations(modes, update(step), 3, PARAMS)
            modes = TrackedModes(np.eye(3, 4)[None], P, *list(vars(modes).values())[2:])
            step = sign * step
        assert are_inconsistent(modes, PARAMS)[0] == slips


def test_a_touch_that_is_off_by_more_than_noise_is_inconsistent() -> None:
    modes = make_modes()
    for _ in range(5):
        modes = record_innovations(modes, update(np.zeros(3), 40.0), 3, PARAMS)
    assert are_inconsistent(modes, PARAMS)[0]


def test_a_direction_that_seems_to_have_shrunk_is_consistent() -> None:
    """Tangent spaces turn from frame to frame, by which a narrow direction seems to widen: then nothing is expected."""
    modes = make_modes()
    for i in range(20):
        wider = update(np.array([1e-5 * (-1.0) ** i, 0.0, 0.0]))._replace(covariance=1.5 * P)
        modes = record_innovations(modes, wider, 3, PARAMS)
        modes = TrackedModes(np.eye(3, 4)[None], P, *list(vars(modes).values())[2:])
    assert not are_inconsistent(modes, PARAMS)[0]
