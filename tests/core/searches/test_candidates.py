import numpy as np

from tactopose_drake.core.poses import retract
from tactopose_drake.core.searches.candidates import CandidatePoses, refine_best
from tactopose_drake.core.searches.levenberg_marquardt import LevenbergMarquardt
from tactopose_drake.core.searches.search import never
from tactopose_drake.core.shape.object_model import ObjectModel
from tests.core.searches.problems import make_touch


def test_candidates_are_remembered_by_cost(blob: ObjectModel) -> None:
    objective, prior, _ = make_touch(blob, 1)
    units = np.repeat([0.5, 0.02], 3)
    candidates = CandidatePoses(objective, prior.mean, units)
    tried = np.random.default_rng(0).uniform(-1.0, 1.0, size=(20, 6))
    costs = [candidates.try_pose(y) for y in tried]
    X_PO = retract(prior.mean, tried * units)
    np.testing.assert_allclose(costs, objective.cost(X_PO))
    np.testing.assert_allclose(candidates.pose(tried[3]), X_PO[3])
    candidates.remember(np.zeros(6), -1.0)
    assert len(candidates) == 21
    np.testing.assert_allclose(candidates.by_cost(), np.concatenate([prior.mean[None], X_PO[np.argsort(costs)]]))


def test_of_poses_that_are_close_one_is_refined(blob: ObjectModel) -> None:
    objective, _, X_true = make_touch(blob, 1)
    far = retract(X_true, np.array([0.0, 0.0, 1.0, 0.03, 0.0, 0.0]))
    near_poses = [retract(X, np.array([1e-4, 0.0, 0.0, 1e-5, 0.0, 0.0])) for X in (X_true, far)]
    X_PO = np.stack([X_true, near_poses[0], far, near_poses[1]])
    staying = LevenbergMarquardt(max_iterations=1, initial_damping=1e30)
    assert len(refine_best(objective, X_PO, 5, staying, never).cost) == 2
    found = refine_best(objective, X_PO, 1, staying, never)
    np.testing.assert_allclose(found.X_PO, X_true[None], atol=1e-9)
