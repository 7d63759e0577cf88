import dataclasses

import numpy as np
import pytest

from tactopose_drake.core.tracking.tracked_modes import TrackedModes
from tactopose_drake.core.tracking.tracker_params import MixtureParams
from tests.core.tracking.rough_modes import SOURCES, make_rough_modes


def test_widened_modes_are_as_wide_as_either() -> None:
    modes = make_rough_modes(1.0)
    other = modes.covariance[::-1].copy()
    wider = modes.widened(other)
    for before in (modes.covariance, other):
        scale = np.abs(before).max()
        assert np.linalg.eigvalsh(wider.covariance - before).min() > -1e-9 * scale
    np.testing.assert_allclose(modes.widened(0.5 * modes.covariance).covariance, modes.covariance, rtol=1e-9)
    np.testing.assert_allclose(modes.widened(3.0 * modes.covariance).covariance, 3.0 * modes.covariance, rtol=1e-9)


def test_pruned_are_the_heaviest_and_sum_to_one() -> None:
    modes = make_rough_modes(0.0).chosen([0, 1, 0, 1])
    modes = dataclasses.replace(modes, log_weight=np.array([6.0, 10.0, -33.0, 9.0]))
    pruned = modes.pruned(MixtureParams(max_modes=3, least_share=0.05))
    np.testing.assert_array_equal(pruned.X_PO, modes.X_PO[[1, 3]])
    assert np.logaddexp.reduce(pruned.log_weight) == pytest.approx(0.0, abs=1e-12)
    assert np.diff(pruned.log_weight)[0] == pytest.approx(-1.0)
    assert len(TrackedModes.empty(2).pruned(MixtureParams())) == 0


def test_new_sources_are_unknown_to_the_modes() -> None:
    modes = make_rough_modes(1.0)
    wider = modes.with_sources(SOURCES + 2)
    np.testing.assert_array_equal(wider.cross_covariance[:, :, : 6 * SOURCES], modes.cross_covariance)
    np.testing.assert_array_equal(wider.cross_covariance[:, :, 6 * SOURCES :], np.zeros((2, 6, 12)))
    np.testing.assert_array_equal(wider.roughness[:, SOURCES:], np.zeros((2, 2, 2)))
    assert wider.with_sources(SOURCES) is wider
