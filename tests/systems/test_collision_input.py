"""How deep an object is in a hand, for systems that are told the hand's joints."""

from pathlib import Path

import numpy as np
import pytest
import trimesh

from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.hand.collision import HandCollision
from tactopose_drake.systems.collision_input import PosedHandCollision
from tests.hands import write_hand

TOLERANCE = 2e-5  # m, by which depths may be short


def test_depths_up_to_two_centimetres_are_exact_and_greater_ones_are_at_least_that(tmp_path: Path) -> None:
    """A wall pushed into a large ball, of whose triangles the deepest are not the first that are looked at."""
    hand = write_hand(tmp_path, "<sphere><radius>0.1</radius></sphere>")
    mesh = trimesh.creation.icosphere(subdivisions=4, radius=0.06)
    model = ObjectModel.from_mesh(mesh, spacing=0.005, samples=100, symmetry="none", cache=False)
    collision = HandCollision(hand, model)
    posed = PosedHandCollision(collision, np.zeros(1), collision.make_scratch())
    X_PO, true = np.tile(np.eye(3, 4), (40, 1, 1)), np.linspace(-0.002, 0.05, 40)
    ways = np.random.default_rng(0).choice(mesh.vertices, 40) / 0.06
    X_PO[:, :, 3] = -(0.16 - true)[:, None] * ways
    found, exact = posed.depth(X_PO), np.maximum(true, 0.0)
    shallow = true < 0.02
    np.testing.assert_allclose(found[shallow], exact[shallow], atol=TOLERANCE)
    assert np.all((found[~shallow] > 0.02) & (found[~shallow] < exact[~shallow] + 1e-9))
    deeper = (true > 0.025) & (true < 0.035)
    assert found[deeper] != pytest.approx(exact[deeper], abs=TOLERANCE), "of these no more is to be found out"
