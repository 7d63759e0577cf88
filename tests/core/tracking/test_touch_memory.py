import math

import numpy as np
import pytest
from scipy.linalg import eigh

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.tracking.mode_set import ModeSet
from tactopose_drake.core.tracking.touch_memory import fade, remember, worth_of_a_frame
from tests.core.tracking.boxes import SIGMA_NORMAL, SIGMA_POSITION, make_box, n_OC, p_OC


def make_modes(covariance: np.ndarray) -> ModeSet:
    n = len(covariance)
    X_PO, even = np.tile(np.eye(3, 4), (n, 1, 1)), np.zeros((n, 6, 2))
    return ModeSet.make(X_PO, covariance, np.zeros((n, 6, 36)), even, np.zeros(n), np.zeros(n))


@pytest.fixture(scope="module")
def box() -> ObjectModel:
    return make_box()


@pytest.mark.parametrize("stays", [0.1, 0.5])
def test_equal_frames_are_worth_as_much_as_their_mean(stays: float) -> None:
    """Of a variance B + R the mean of N frames leaves B + R / N."""
    modes = make_modes(np.eye(6)[None])
    for count in range(1, 40):
        modes = remember(modes, np.array([-2.0]), stays)
        worth = 1.0 / (stays + (1.0 - stays) / count)
        np.testing.assert_allclose(modes.log_weight, -2.0 * worth)
        np.testing.assert_allclose(worth_of_a_frame(modes, stays), worth / count)


def test_evidence_that_lasts_counts_no_more_than_the_share_that_is_new_allows() -> None:
    modes = make_modes(np.eye(6)[None])
    for _ in range(1000):
        modes = remember(modes, np.array([-2.0]), 0.25)
    assert -2.0 / 0.25 < modes.log_weight[0] < -0.9 * 2.0 / 0.25


def test_noise_of_single_frames_hardly_moves_the_weights() -> None:
    generator = np.random.default_rng(0)
    modes, differences = make_modes(np.tile(np.eye(6), (2, 1, 1))), []
    for i in range(600):
        # Alike but for noise: no one frame may make one of them certain.
        modes = remember(modes, 3.0 * generator.normal(size=2), 0.3)
        if i > 100:
            differences.append(modes.log_weight[0] - modes.log_weight[1])
    # A sum of the latest 1 / 0.3 frames would have a standard deviation of 3 sqrt(2 / (0.3 1.7)) = 5.9.
    assert np.std(differences) < 2.5


def test_what_the_touch_tells_of_fades_and_nothing_else(box: ObjectModel) -> None:
    one_face = Contacts(p_OC[:1], sigma_position=SIGMA_POSITION)
    covariance = np.diag(np.repeat([math.radians(0.01) ** 2, SIGMA_POSITION**2], 3))
    faded = fade(box, one_face, make_modes(covariance[None]), 0.2).covariance[0]
    growth = np.diag(faded)[3:] / np.diag(covariance)[3:] - 1.0
    along = np.abs(n_OC[0])
    # A frame tells as much as is known: 1 / (1 + 0.1) of the share.
    assert along @ growth == pytest.approx(0.2 / 1.1, rel=0.05)
    assert (1.0 - along) @ growth < 1e-6
    np.testing.assert_allclose(faded, faded.T, atol=1e-20)


def test_what_is_known_far_better_than_the_touch_tells_stays(box: ObjectModel) -> None:
    contacts = Contacts(p_OC, n_OC, sigma_position=SIGMA_POSITION, sigma_normal=SIGMA_NORMAL)
    tight, wide = (np.diag(np.repeat([(a * 0.05) ** 2, (a * 0.003) ** 2], 3)) for a in (0.01, 1.0))
    faded = fade(box, contacts, make_modes(np.stack([tight, wide])), 0.2).covariance
    assert eigh(faded[0], tight, eigvals_only=True).max() < 1.01
    assert eigh(faded[1], wide, eigvals_only=True).max() > 1.15
