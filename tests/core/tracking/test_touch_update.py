import math

import numpy as np
import pytest

from tactopose_drake.core.poses import retract
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.tracking.contact_update import Stable
from tactopose_drake.core.tracking.frame_touch import FrameTouch
from tactopose_drake.core.tracking.looking_elsewhere import Look
from tactopose_drake.core.tracking.mode_set import ModeSet
from tactopose_drake.core.tracking.touch_memory import remember
from tactopose_drake.core.tracking.touch_update import Felt, feel, join
from tests.core.tracking.boxes import make_box, touch

STABLE = Stable((0.0005, math.radians(2.5)), (0.0001, math.radians(1.0)))
X_PO = np.eye(3, 4)


@pytest.fixture(scope="module")
def box() -> ObjectModel:
    return make_box()


def felt_often(box: ObjectModel, frames: int, forgotten: float = 0.0) -> Felt:
    """Two modes, of which the second is right, after frames of a touch."""
    generator = np.random.default_rng(0)
    X_start = np.stack([retract(X_PO, np.array([0, 0, 0, 0.004, 0, 0.0])), X_PO])
    covariance = np.tile(np.diag(np.repeat([0.02**2, 0.001**2], 3)), (2, 1, 1))
    modes = ModeSet.make(X_start, covariance, np.zeros((2, 6, 36)), np.zeros((2, 6, 2)), np.zeros(2), np.zeros(2))
    for _ in range(frames):
        one = FrameTouch(touch(X_PO, generator), np.arange(6), tuple("abcdef"), True)
        felt = feel(box, one, STABLE, modes, forgotten)
        modes = felt.modes
    return felt


def test_the_right_mode_comes_first(box: ObjectModel) -> None:
    felt = felt_often(box, 1)
    assert np.linalg.norm(felt.modes.X_PO[0, :, 3]) < np.linalg.norm(felt.modes.X_PO[1, :, 3])
    assert felt.modes.log_weight[0] > felt.modes.log_weight[1]


@pytest.mark.parametrize("frames", [5, 30])
def test_what_is_found_weighs_what_it_explains_and_has_felt_what_the_best_has(box: ObjectModel, frames: int) -> None:
    felt = felt_often(box, frames)
    one = felt.modes.chosen([0])
    # As a search gives it: the touch explained 20 nats better than by all modes together.
    cross = np.zeros((1, 6, 36))
    found = ModeSet.make(
        one.X_PO, one.covariance, cross, one.roughness, np.array([felt.log_evidence + 22.0]), np.array([-2.0])
    )
    joined = join(felt, found, Look(None, 0.01, True))
    gain = joined.log_weight[-1] - np.logaddexp.reduce(felt.modes.log_weight)
    assert gain == pytest.approx(20.0 + math.log(0.01))
    # Frames that say the same of both never tell them apart, as the found one has no better past.
    assert joined.frames[-1] == joined.frames[0]
    after = joined
    for _ in range(100):
        after = remember(after, np.zeros(len(joined)), 0.3)
    changed = np.diff(after.log_weight[[0, -1]])[0] - np.diff(joined.log_weight[[0, -1]])[0]
    assert changed == pytest.approx(0.0, abs=0.3 * abs(felt.log_before))


def test_a_belief_that_was_wrong_gives_what_is_found_its_share_however_well_it_foretold_the_touch(
    box: ObjectModel,
) -> None:
    felt = felt_often(box, 5)
    cross, even = np.zeros((2, 6, 36)), np.zeros((2, 6, 2))
    log_prior = felt.log_evidence - np.array([20.0, 20.0 + math.log(3.0)])
    found = ModeSet.make(felt.modes.X_PO, felt.modes.covariance, cross, even, log_prior, np.zeros(2))
    joined = join(felt, found, Look(None, 0.02, False))
    gain = np.exp(joined.log_weight[2:] - np.logaddexp.reduce(felt.modes.log_weight))
    np.testing.assert_allclose(gain, [0.015, 0.005])
    assert join(felt, found.chosen([]), Look(None, 0.02, False)) is felt.modes


def test_what_fades_leaves_the_pose_less_sure(box: ObjectModel) -> None:
    spread = [np.trace(felt_often(box, 30, forgotten).modes.covariance[0][3:, 3:]) for forgotten in (0.0, 0.05)]
    assert 1.03 * spread[0] < spread[1] < 2.0 * spread[0]
