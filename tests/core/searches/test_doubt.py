import numpy as np
import trimesh

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.evidence.evidence import Evidence
from tactopose_drake.core.evidence.gaussian_prior import GaussianPrior
from tactopose_drake.core.poses import increments_between, make_poses, random_rotations
from tactopose_drake.core.searches.doubt import search_with_doubt
from tactopose_drake.core.searches.levenberg_marquardt import LevenbergMarquardt
from tactopose_drake.core.searches.pair_search import PairSearch
from tactopose_drake.core.searches.pose_problem import make_problem
from tactopose_drake.core.searches.touch_space import TouchSpace
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.synthetic.synthetic_touch import touch_surface


def test_where_one_contact_is_false_poses_are_proposed_that_the_others_suit(blob: ObjectModel) -> None:
    near = {0: 0, 1: 0}
    for seed in range(20):
        generator = np.random.default_rng(seed)
        X_PO = make_poses(random_rotations(generator, 1), 0.03 * generator.normal(size=(1, 3)))[0]
        felt = touch_surface(blob, X_PO, 5, generator, spread=True)
        p_PC = felt.p_PC.copy()
        p_PC[seed % 5] += 0.025 * felt.n_PC[seed % 5]
        contacts = Contacts(p_PC, felt.n_PC)
        search, space = PairSearch(model=blob, contacts=contacts), TouchSpace(blob, contacts)
        for spared, X in enumerate(search.proposals(space, generator).best(30, 30)):
            errors = increments_between(X_PO, X)
            near[spared] += bool(
                np.any((np.linalg.norm(errors[:, :3], axis=1) < 0.3) & (np.linalg.norm(errors[:, 3:], axis=1) < 0.02))
            )
    assert near[1] >= 15 > near[0]


def test_a_search_without_one_contact_finds_what_a_false_one_hides() -> None:
    """Two boxes glued together, which no symmetry maps onto itself, and one finger of seven far off."""
    parts = [trimesh.creation.box((0.05, 0.08, 0.12)), trimesh.creation.box((0.03, 0.05, 0.07))]
    parts[1].apply_translation([0.035, 0.01, -0.02])
    model = ObjectModel.from_mesh(trimesh.boolean.union(parts, engine="manifold"))
    found_by = {"all": 0, "doubt": 0}
    for seed in range(24):
        generator = np.random.default_rng(seed)
        X_PO = make_poses(random_rotations(generator, 1), 0.03 * generator.normal(size=(1, 3)))
        felt = touch_surface(model, X_PO[0], 7, generator, spread=True)
        p_PC = felt.p_PC.copy()
        p_PC[3] += 0.025 * felt.n_PC[3]
        contacts = Contacts(p_PC, felt.n_PC)
        evidence = Evidence(contacts)
        problem, search = make_problem(model, evidence), PairSearch(model=model, contacts=contacts)
        found = search.minimize(problem.objective, problem.space, generator)
        doubted = search_with_doubt(problem, search, generator)
        for name, result in (("all", found), ("doubt", doubted)):
            error = increments_between(X_PO[0], result.X_PO[:1])[0]
            found_by[name] += bool(np.linalg.norm(error[3:]) < 0.005 and np.linalg.norm(error[:3]) < 0.2)
    assert found_by["doubt"] >= 18 > found_by["all"]


def test_a_search_that_knows_nothing_of_doubt_leads_on_with_it(blob: ObjectModel) -> None:
    generator = np.random.default_rng(3)
    X_PO = make_poses(random_rotations(generator, 1), 0.03 * generator.normal(size=(1, 3)))[0]
    felt = touch_surface(blob, X_PO, 8, generator, spread=True)
    p_PC = felt.p_PC.copy()
    p_PC[2] += 0.015 * felt.n_PC[2]
    prior = GaussianPrior(X_PO, sigma_translation=0.005, sigma_rotation=0.1)
    problem = make_problem(blob, Evidence(Contacts(p_PC, felt.n_PC), prior))
    believed = LevenbergMarquardt().minimize(problem.objective, problem.space, generator)
    found = search_with_doubt(problem, LevenbergMarquardt(), generator)
    doubted = problem.doubted(problem.objective)
    assert found.cost[0] < doubted.cost(believed.X_PO)[0] - 1.0
    assert np.linalg.norm(found.X_PO[0, :, 3] - X_PO[:, 3]) < np.linalg.norm(believed.X_PO[0, :, 3] - X_PO[:, 3])


def test_a_search_with_doubt_that_may_take_no_time_says_what_it_has(blob: ObjectModel) -> None:
    generator = np.random.default_rng(4)
    X_PO = make_poses(random_rotations(generator, 1), 0.03 * generator.normal(size=(1, 3)))[0]
    felt = touch_surface(blob, X_PO, 5, generator, spread=True)
    for prior in (None, GaussianPrior(X_PO)):
        problem = make_problem(blob, Evidence(felt, prior))
        found = search_with_doubt(problem, PairSearch(model=blob, contacts=felt), generator, lambda: True)
        assert len(found.X_PO)
        assert np.isfinite(found.cost).all()
        np.testing.assert_allclose(found.cost, problem.doubted(problem.objective).cost(found.X_PO), atol=1e-9)
