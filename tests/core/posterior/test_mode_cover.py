import dataclasses
import math

import numpy as np
import pytest

from tactopose_drake.core.poses import increments_between, retract
from tactopose_drake.core.posterior.importance_sampling import weigh_modes
from tactopose_drake.core.posterior.mode_cover import cover_modes
from tactopose_drake.core.posterior.posterior_params import PosteriorParams
from tactopose_drake.core.validation import FloatArray
from tests.core.posterior.valleys import Valley, modes, posterior


@pytest.mark.parametrize(("turn", "fewest", "most"), [(1.0, 16, 16), (20.0, 20, 80), (60.0, 81, 128)])
def test_the_wider_a_mode_is_the_more_tiles_cover_it(turn: float, fewest: int, most: int) -> None:
    sigmas = np.array([0.01, 0.01, math.radians(turn), 0.001, 0.001, 0.001])
    valley = Valley(np.eye(3, 4), sigmas)
    asked = dataclasses.replace(posterior(valley), params=PosteriorParams())
    cover = cover_modes(modes(valley, np.eye(3, 4)[None]), asked, np.random.default_rng(0))
    assert cover is not None
    assert fewest <= cover.tiles <= most
    assert cover.proposal.count.sum() >= 4 * cover.tiles


def test_modes_that_samples_find_a_way_between_are_one() -> None:
    """Along an arc of 100 mm lie three minima, of which those at the ends are known: the straight way is a high one."""

    class Arc(Valley):
        def residuals(self, X_PO: FloatArray) -> FloatArray:
            rows = super().residuals(X_PO)
            turn = increments_between(self.X_PO, X_PO)[:, 2]
            rows[:, 2] = 1.2 * np.sin(3.0 * turn)
            return rows

    arc = Arc(np.eye(3, 4), np.array([0.02, 0.02, 1.0, 0.001, 0.001, 0.001]), bend=0.1)
    turns = np.pi / 3.0 * np.array([-1.0, 1.0])
    u = np.zeros((2, 6))
    u[:, 2], u[:, 3], u[:, 4] = turns, 0.1 * (1.0 - np.cos(turns)), 0.1 * np.sin(turns)
    X_PO = retract(np.tile(np.eye(3, 4), (2, 1, 1)), u)
    np.testing.assert_allclose(arc.cost(X_PO), 0.0, atol=1e-9)
    found = weigh_modes(
        modes(arc, X_PO), dataclasses.replace(posterior(arc), params=PosteriorParams()), np.random.default_rng(0)
    )
    assert len(found.mixture) == 1
