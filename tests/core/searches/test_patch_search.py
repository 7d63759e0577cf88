import dataclasses
import math

import numpy as np
import pytest

from tactopose_drake.core.evidence.gaussian_prior import GaussianPrior
from tactopose_drake.core.evidence.patch_contacts import patch_contacts
from tactopose_drake.core.objectives.covariance_matching import CovarianceMatching
from tactopose_drake.core.objectives.objective import SumObjective
from tactopose_drake.core.objectives.patch_contact import PatchContact
from tactopose_drake.core.objectives.pose_prior import PriorObjective
from tactopose_drake.core.poses import increments_between, make_poses, random_rotations, retract
from tactopose_drake.core.searches.levenberg_marquardt import LevenbergMarquardt
from tactopose_drake.core.searches.patch_searches import corner_search, patch_search
from tactopose_drake.core.searches.search import PriorSpace
from tactopose_drake.core.searches.touch_space import TouchSpace
from tactopose_drake.core.sensing.patches import Patch
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.shape.point_grid import build_point_grid
from tactopose_drake.core.synthetic.synthetic_patch import touch_with_pads
from tests.core.meshes import shape_poor_in_symmetry


@pytest.fixture(scope="module")
def model() -> ObjectModel:
    return ObjectModel.from_mesh(shape_poor_in_symmetry())


def touch(model: ObjectModel, seed: int, count: int = 4) -> tuple[np.ndarray, tuple[Patch, ...]]:
    generator = np.random.default_rng(seed)
    X_PO = make_poses(random_rotations(generator, 1), 0.05 * generator.normal(size=(1, 3)))[0]
    return X_PO, touch_with_pads(model, X_PO, count, generator)


def test_without_a_prior_no_pose_known_is_better_than_the_best_found(model: ObjectModel) -> None:
    as_good = 0
    for seed in range(8):
        X_PO, patches = touch(model, seed)
        objective, space = PatchContact(model.grid, patches), TouchSpace(model, patch_contacts(patches))
        found = patch_search(model, patches).minimize(objective, space, np.random.default_rng(0))
        as_good += found.cost[0] <= LevenbergMarquardt().refine(objective, X_PO[None]).cost[0] + 0.5
        assert np.all(np.diff(found.cost) >= 0)
        np.testing.assert_allclose(found.cost, objective.cost(found.X_PO), rtol=1e-6)
    assert as_good == 8


def test_near_a_prior_it_finds_the_pose(model: ObjectModel) -> None:
    near = 0
    for seed in range(8):
        X_PO, patches = touch(model, seed)
        w, v = np.random.default_rng(seed).uniform(-1.0, 1.0, (2, 3))
        prior = GaussianPrior(
            retract(X_PO, np.concatenate([math.radians(20.0) * w, 0.01 * v])), 0.006, math.radians(12.0)
        )
        objective = SumObjective([PatchContact(model.grid, patches), PriorObjective(prior)])
        search = patch_search(model, patches)
        found = search.minimize(objective, PriorSpace(prior), np.random.default_rng(0))
        off = increments_between(found.X_PO[:1], X_PO[None])[0]
        near += np.linalg.norm(off[:3]) < math.radians(10.0) and np.linalg.norm(off[3:]) < 0.01
    assert near >= 7


def test_one_patch_is_enough_to_touch(model: ObjectModel) -> None:
    _, patches = touch(model, 3, count=1)
    objective, space = PatchContact(model.grid, patches), TouchSpace(model, patch_contacts(patches))
    found = patch_search(model, patches).minimize(objective, space, np.random.default_rng(0))
    assert found.cost[0] < 3.0


def test_the_same_seed_gives_the_same_poses(model: ObjectModel) -> None:
    _, patches = touch(model, 4)
    objective, space = PatchContact(model.grid, patches), TouchSpace(model, patch_contacts(patches))
    search = patch_search(model, patches)
    first, second = (search.minimize(objective, space, np.random.default_rng(5)) for _ in range(2))
    np.testing.assert_array_equal(first.X_PO, second.X_PO)


def test_where_the_cost_jumps_it_is_found_without_derivatives(model: ObjectModel) -> None:
    cloud, costs = build_point_grid(model.samples.points), []
    for seed in range(4):
        X_PO, patches = touch(model, seed)
        off = np.random.default_rng(seed).uniform(-1.0, 1.0, 6) * ([0.35] * 3 + [0.01] * 3)
        space = PriorSpace(GaussianPrior(retract(X_PO, off), 0.006, math.radians(12.0)))
        objective = CovarianceMatching(cloud, patches)
        found = [
            search(model, patches).minimize(objective, space, np.random.default_rng(0))
            for search in (corner_search, patch_search)
        ]
        np.testing.assert_allclose(found[0].cost, objective.cost(found[0].X_PO), rtol=1e-12)
        costs.append([found[0].cost[0], found[1].cost[0], objective.cost(X_PO[None])[0]])
    by_costs, by_derivatives, at_the_truth = np.mean(costs, axis=0)
    assert by_costs < 0.8 * min(by_derivatives, at_the_truth)


def test_no_population_leaves_the_space(model: ObjectModel) -> None:
    """Though the touch is a way off."""
    X_PO, patches = touch(model, 1)
    space = PriorSpace(
        GaussianPrior(retract(X_PO, np.array([0.0, 0.0, 0.0, 0.02, 0.0, 0.0])), 0.001, math.radians(5.0))
    )
    objective = CovarianceMatching(build_point_grid(model.samples.points), patches)
    search = dataclasses.replace(corner_search(model, patches), samples=50, rounds=10)
    found = search.minimize(objective, space, np.random.default_rng(0))
    off = np.abs(increments_between(space.center, found.X_PO))
    assert np.all(off <= np.repeat(space.reach, 3) * (1 + 1e-9))
    assert off[:, 3].max() > 0.9 * space.reach[1]
