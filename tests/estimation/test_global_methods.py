"""Every method that needs no prior, through the public call, on touches that are easy, odd, and impossible."""

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
import trimesh

import tactopose_drake as tp
from tactopose_drake.core.evidence.evidence import Evidence
from tactopose_drake.core.evidence.hand_geometry import HandGeometry
from tactopose_drake.core.objectives.surface_contact import SurfaceContact
from tactopose_drake.core.poses import exp_so3, make_poses, transform_points
from tactopose_drake.core.searches.baselines.monte_carlo import MonteCarlo
from tactopose_drake.core.searches.levenberg_marquardt import LevenbergMarquardt
from tactopose_drake.core.synthetic.synthetic_patch import touch_with_pads
from tactopose_drake.core.synthetic.synthetic_touch import touch_surface
from tactopose_drake.estimation.prior import PosePrior
from tactopose_drake.estimation.search_methods import GLOBAL_METHODS, METHODS

NAMES = sorted(GLOBAL_METHODS)
X_PO = make_poses(exp_so3(np.array([0.3, -0.8, 0.2])), np.array([0.02, -0.03, 0.06]))


@pytest.fixture(scope="module")
def ball() -> tp.ObjectModel:
    return tp.ObjectModel.from_mesh(trimesh.creation.icosphere(subdivisions=4, radius=0.03))


def test_they_are_those_of_the_design() -> None:
    assert NAMES == ["direct", "monte_carlo", "pair_search", "scaling_series", "simulated_annealing"]


@pytest.mark.parametrize("method", NAMES)
def test_a_prior_is_corrected(blob: tp.ObjectModel, method: str) -> None:
    contacts = touch_surface(blob, X_PO, 8, np.random.default_rng(0))
    guess = make_poses(X_PO[:, :3] @ exp_so3(np.array([0.1, 0.1, -0.1])), X_PO[:, 3] + [0.01, -0.01, 0.01])
    estimate = tp.estimate_pose(blob, contacts, prior=PosePrior(guess), method=method)
    assert estimate.status in ("ok", "ambiguous")
    assert estimate.finished
    assert np.linalg.norm(estimate.best.X_PO.translation() - X_PO[:, 3]) < 0.005


@pytest.mark.parametrize("method", NAMES)
@pytest.mark.parametrize("count", [1, 2, 50])
@pytest.mark.parametrize("shape", ["blob", "ball"])
def test_every_touch_has_an_estimate_within_its_time(
    blob: tp.ObjectModel, ball: tp.ObjectModel, method: str, count: int, shape: str
) -> None:
    model = {"blob": blob, "ball": ball}[shape]
    contacts = touch_surface(model, X_PO, count, np.random.default_rng(1))
    estimate = tp.estimate_pose(model, contacts, method=method, time_limit=0.1)
    assert len(estimate.hypotheses) >= 1
    assert np.isfinite(estimate.best.cost)
    assert sum(hypothesis.probability for hypothesis in estimate.hypotheses) == pytest.approx(1.0)


@pytest.mark.parametrize("method", NAMES)
def test_contacts_metres_apart_have_no_solution(blob: tp.ObjectModel, method: str) -> None:
    contacts = tp.Contacts(np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]), np.eye(3))
    assert tp.estimate_pose(blob, contacts, method=method, time_limit=0.1).status == "no_solution"


def test_monte_carlo_discards_what_the_hand_collides_with(blob: tp.ObjectModel) -> None:
    contacts = touch_surface(blob, X_PO, 8, np.random.default_rng(0))
    prior = PosePrior(X_PO, sigma_translation=0.01, sigma_rotation=0.1)
    hand = HandGeometry(transform_points(X_PO, blob.samples.points[:1]), np.array([0.004]))
    search = METHODS["monte_carlo"](blob, Evidence(contacts, prior, hand))
    assert isinstance(search, MonteCarlo)
    assert search.is_possible is not None
    away = make_poses(X_PO[:, :3], X_PO[:, 3] + [0.2, 0.0, 0.0])
    np.testing.assert_array_equal(search.is_possible(np.stack([X_PO, away])), [False, True])


def test_monte_carlo_makes_one_particle_at_a_time_by_contacts_alone_and_more_where_each_costs_more(
    blob: tp.ObjectModel,
) -> None:
    contacts = touch_surface(blob, X_PO, 5, np.random.default_rng(0))
    plane = tp.PlaneContact([0.0, 0.0, float(transform_points(X_PO, blob.vertices)[:, 2].min())], [0.0, 0.0, 1.0])
    known: list[dict[str, Any]] = [{}, {"friction": 0.0}, {"planes": [plane]}]
    forces = dataclasses.replace(contacts, f_PC=-contacts.n_PC)
    made = [METHODS["monte_carlo"](blob, Evidence(forces, **each)) for each in known]
    assert [search.batch for search in made if isinstance(search, MonteCarlo)] == [1, 20, 20]
    estimate = tp.estimate_pose(blob, contacts, method="monte_carlo", planes=[plane])
    assert estimate.best.explains_touch


def test_monte_carlo_makes_fewer_particles_where_pads_are_felt(blob: tp.ObjectModel) -> None:
    generator = np.random.default_rng(0)
    contacts, patches = touch_surface(blob, X_PO, 5, generator), touch_with_pads(blob, X_PO, 2, generator)
    made = [METHODS["monte_carlo"](blob, Evidence(contacts, patches=felt)) for felt in ((), patches)]
    by_contacts, by_pads = [search.anywhere for search in made if isinstance(search, MonteCarlo)]
    assert by_pads.particles < 0.5 * by_contacts.particles
    assert by_pads.population / by_pads.particles == by_contacts.population / by_contacts.particles


@pytest.mark.parametrize("method", ["pair_search", "scaling_series"])
def test_no_prior_is_needed(blob: tp.ObjectModel, method: str) -> None:
    for seed in range(3):
        contacts = touch_surface(blob, X_PO, 5, np.random.default_rng(seed), sigma_normal=math.radians(3.0))
        truth = LevenbergMarquardt().refine(SurfaceContact(blob.grid, contacts), X_PO[None])
        assert tp.estimate_pose(blob, contacts, method=method).best.cost <= truth.cost[0] + 0.5
