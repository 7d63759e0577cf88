"""Which lean of a rod on a table tells most about it."""

import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw

import tactopose_drake as tp
from tactopose_drake.core.grasping.held_axis import HeldAxis
from tactopose_drake.estimation.pose_hypothesis import PoseHypothesis
from tactopose_drake.estimation.results import PoseEstimate
from tactopose_drake.resources import model_path
from tactopose_drake.station.arms.carried_hand import PlacedHand
from tactopose_drake.station.arms.table_leans import Lean, choose_lean, ends_apart, lean_ways

ANGLES = np.radians([0.0, 20.0, 40.0])
N_P = np.array([[np.sin(angle), 0.0, np.cos(angle)] for angle in ANGLES])  # under a rod that points along -z


@pytest.fixture(scope="module")
def pencil() -> tp.ObjectModel:
    return tp.ObjectModel.from_mesh(model_path("objects", "pencil.obj"), mass=0.0055)


@pytest.fixture(scope="module")
def either() -> PoseEstimate:
    """A pencil 0.175 m long about the origin, either end up."""
    up, down = RigidTransform([0.0, 0.0, -0.0875]), RigidTransform(RollPitchYaw(np.pi, 0.0, 0.0), [0.0, 0.0, 0.0875])
    covariance = np.diag(np.repeat([1e-4**2, 1e-5**2], 3))
    hypotheses = (PoseHypothesis(X_PO, 0.0, 0.5, covariance, np.zeros((0, 6))) for X_PO in (up, down))
    return PoseEstimate(tuple(hypotheses), "ambiguous", 0.0)


def test_ends_are_told_apart_by_a_lean(pencil: tp.ObjectModel, either: PoseEstimate) -> None:
    # A blunt end 3.5 mm wide is lower than a sharp one, as far as its rim is; the touches err by 0.5 mm each.
    apart = ends_apart(pencil, either, N_P)
    np.testing.assert_allclose(apart, (3.5e-3 - 0.45e-3) * np.sin(ANGLES) / (np.sqrt(2.0) * 0.5e-3), atol=0.8)
    assert np.all(np.diff(apart) > 1.0)


def test_nothing_tells_ends_apart_where_one_is_certain(pencil: tp.ObjectModel, either: PoseEstimate) -> None:
    certain = PoseEstimate(either.hypotheses[:1], "ok", 0.0)
    np.testing.assert_array_equal(ends_apart(pencil, certain, N_P), np.zeros(3))


def test_the_lean_that_tells_most_is_chosen_among_those_that_the_hand_allows(
    pencil: tp.ObjectModel, either: PoseEstimate
) -> None:
    lengths = {0.08: (0.05, 0.05, 0.05), 0.07: (0.05, 0.05, 0.09), 0.03: (0.05, 0.04, 0.09)}
    # Where the rod may be so short that none is allowed, it is the one for the shortest rods.
    for (least_end, least_ends), chosen in zip(lengths.items(), (2, 1, 1), strict=True):
        leans = [Lean(n_P, length) for n_P, length in zip(N_P, least_ends, strict=True)]
        assert choose_lean(pencil, either, leans, least_end)[0] is leans[chosen]


def test_the_hand_is_clear_of_the_table_where_the_rod_is_long_enough() -> None:
    """A ball beside the rod: leaning towards its side asks for a longer rod, leaning away for a shorter one."""
    hand = PlacedHand(RigidTransform(), np.array([[0.05, 0.0, 0.0]]), np.array([0.03]))
    held = HeldAxis(np.zeros(3), np.array([0.0, 0.0, -1.0]), 0.0875)
    leans = lean_ways(held, hand, 0.01, np.radians(45.0))
    for lean in leans:
        p_PE = lean.least_end * held.direction  # on the table
        assert (hand.p_PH[0] - p_PE) @ lean.n_P == pytest.approx(0.03 + 0.01)
        assert np.arccos(lean.n_P[2]) < np.radians(45.0) + 1e-9
    towards = max(leans, key=lambda lean: lean.least_end)
    assert towards.n_P[0] < -0.5
