"""The mass of a posterior by its samples, against a plain sum over the one mode that it has, in the same measure."""

import numpy as np
import pytest
import trimesh

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.evidence.evidence import Evidence
from tactopose_drake.core.poses import retract
from tactopose_drake.core.posterior.importance_sampling import weigh_modes
from tactopose_drake.core.posterior.modes import find_modes
from tactopose_drake.core.posterior.posterior import make_posterior
from tactopose_drake.core.searches.levenberg_marquardt import LevenbergMarquardt
from tactopose_drake.core.searches.pose_problem import make_problem
from tactopose_drake.core.shape.object_model import ObjectModel

ANGLES, HEIGHTS = np.array([0.3, 1.7, 2.9, 4.4]), np.array([0.02, -0.03, 0.01, -0.01])
ROUND = (
    np.vstack([np.column_stack([0.03 * np.cos(ANGLES), 0.03 * np.sin(ANGLES), HEIGHTS]), [[0.01, 0.005, 0.05]]]),
    np.vstack([np.column_stack([np.cos(ANGLES), np.sin(ANGLES), 0.0 * ANGLES]), [[0.0, 0.0, 1.0]]]),
)
FLAT = (
    np.array(
        [
            [0.025, 0.01, 0.02],
            [-0.025, -0.02, 0.01],
            [0.005, 0.04, -0.02],
            [0.01, -0.01, 0.055],
            [-0.005, -0.04, 0.03],
        ]
    ),
    np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]]),
)
WIDER = 1.6  # than the mode, so that the sum has its tails


@pytest.mark.parametrize("is_round", [False, True])
def test_the_mass_is_that_of_a_plain_sum_over_the_mode(is_round: bool) -> None:
    """Of a solid of revolution the turns about its axis, z, count as 2 pi."""
    mesh = trimesh.creation.cylinder(0.03, 0.1, sections=256) if is_round else trimesh.creation.box((0.05, 0.08, 0.11))
    model = ObjectModel.from_mesh(mesh, cache=False)
    evidence = Evidence(Contacts(*(ROUND if is_round else FLAT)), outlier_probability=0.0)
    problem = make_problem(model, evidence)
    found = LevenbergMarquardt().refine(problem.doubted(problem.objective), np.eye(3, 4)[None])
    hessian = problem.determining.normal_equations(found.X_PO).hessian
    modes = find_modes(found.X_PO, found.cost, hessian, problem.space.information, model.symmetry_poses, model.size, 64)
    posterior = make_posterior(model, evidence, problem)
    masses = [weigh_modes(modes, posterior, np.random.default_rng(seed)).log_mass for seed in range(3)]

    assert len(posterior.turn_axes) == is_round
    kept = [0, 1, 3, 4, 5] if is_round else list(range(6))
    root = WIDER * np.linalg.cholesky(np.linalg.inv(hessian[0][np.ix_(kept, kept)]))
    white = np.random.default_rng(1).normal(size=(40_000, len(kept)))
    u = np.zeros((len(white), 6))
    u[:, kept] = white @ root.T
    cost = posterior.exact_cost(retract(found.X_PO[:1], u))
    log_density = -0.5 * np.sum(white**2, axis=1) - np.log(np.diag(root)).sum() - 0.5 * len(kept) * np.log(2.0 * np.pi)
    log_mass = np.logaddexp.reduce(-cost - log_density) - np.log(len(white))
    log_mass += np.log(2.0 * np.pi) if is_round else 0.0
    np.testing.assert_allclose(masses, log_mass, atol=0.25)
