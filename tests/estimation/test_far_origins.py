"""An object's pose does not depend on where its file has the origin."""

import re

import numpy as np
import pytest
import trimesh
from pydrake.math import RigidTransform

import tactopose_drake as tp
from tactopose_drake.core.evidence import GaussianPrior
from tactopose_drake.core.poses import make_poses, matrix_from_quaternion, retract, transform_points
from tactopose_drake.core.posterior.moved_origin import has_far_origin
from tactopose_drake.core.synthetic.synthetic_touch import touch_surface
from tactopose_drake.estimation.descriptions import free_line
from tactopose_drake.estimation.far_origins import about_middle
from tactopose_drake.resources import model_path

OFFSET = np.array([1.2, -0.9, 0.8])
X_PO = make_poses(matrix_from_quaternion(np.array([0.8, 0.2, -0.4, 0.4])), np.array([0.01, -0.03, 0.09]))


@pytest.fixture(scope="module")
def models() -> tuple[tp.ObjectModel, tp.ObjectModel]:
    """A bottle about its middle, and the same in a frame 1.7 m away."""
    mesh = trimesh.load(model_path("objects", "spray_bottle.obj"), force="mesh")
    mesh.apply_translation(-mesh.bounds.mean(axis=0))
    far = mesh.copy()
    far.apply_translation(OFFSET)
    return tp.ObjectModel.from_mesh(mesh, cache=False), tp.ObjectModel.from_mesh(far, cache=False)


def test_a_prior_of_another_type_is_refused(models: tuple[tp.ObjectModel, tp.ObjectModel]) -> None:
    contacts = touch_surface(models[0], X_PO, 6, np.random.default_rng(3))
    for model in models:
        for prior in ("here", X_PO, RigidTransform()):
            with pytest.raises(tp.TactoposeError, match=r"^prior must be a PosePrior, not an? \w+\.$"):
                tp.estimate_pose(model, contacts, prior=prior)  # type: ignore[arg-type]
    own = tp.PosePrior(RigidTransform(X_PO) @ RigidTransform(-OFFSET))
    of_core = GaussianPrior(own.mean, own.sigma_translation, own.sigma_rotation)
    given, taken = (tp.estimate_pose(models[1], contacts, prior=prior) for prior in (own, of_core))  # type: ignore[arg-type]
    assert given.best.X_PO.IsExactlyEqualTo(taken.best.X_PO)


@pytest.mark.parametrize("with_prior", [False, True])
def test_a_far_origin_changes_nothing(models: tuple[tp.ObjectModel, tp.ObjectModel], with_prior: bool) -> None:
    near, far = models
    assert not has_far_origin(near)
    assert has_far_origin(far)
    contacts = touch_surface(near, X_PO, 6, np.random.default_rng(3))
    found = []
    for model, offset in ((near, np.zeros(3)), (far, OFFSET)):
        X_prior = RigidTransform(X_PO) @ RigidTransform([0.02, 0.01, -0.02]) @ RigidTransform(-offset)
        estimate = tp.estimate_pose(model, contacts, prior=tp.PosePrior(X_prior) if with_prior else None)
        X_PM = estimate.best.X_PO @ RigidTransform(offset)  # of the bottle's middle
        found.append((estimate, X_PM))
    (a, X_a), (b, X_b) = found
    assert X_a.IsNearlyEqualTo(X_b, 0.01)
    np.testing.assert_allclose(X_a.translation(), X_PO[:, 3], atol=4e-3)
    assert a.best.free_directions.shape == b.best.free_directions.shape == (0, 6)
    assert b.status == a.status
    # The spread of the middle is the same, and that is what people are told.
    assert about_middle(a.best, near) is a.best
    spread = about_middle(b.best, far).covariance
    assert np.sqrt(np.trace(b.best.covariance[3:, 3:])) > 5.0 * np.sqrt(np.trace(spread[3:, 3:]))
    shown = [re.search(r"<td>([0-9.]+)</td><td>([0-9.]+)</td></tr>", e._repr_html_()) for e in (a, b)]
    mm, deg = np.array([[float(cell) for cell in row.groups()] for row in shown if row is not None]).T
    assert mm[1] == pytest.approx(mm[0], rel=0.3, abs=0.1)
    assert deg[1] == pytest.approx(deg[0], rel=0.3, abs=0.1)


def test_a_far_origin_leaves_the_spread_of_the_middle(models: tuple[tp.ObjectModel, tp.ObjectModel]) -> None:
    """On average: the samples of one touch know each deviation to a tenth."""
    near, far = models
    ratios = []
    for seed in range(20):
        contacts = touch_surface(near, X_PO, 6, np.random.default_rng(seed))
        own = tp.estimate_pose(near, contacts, prior=tp.PosePrior(X_PO)).best
        other = tp.estimate_pose(far, contacts, prior=tp.PosePrior(RigidTransform(X_PO) @ RigidTransform(-OFFSET))).best
        ratios.append(np.diag(about_middle(other, far).covariance) / np.diag(own.covariance))
    np.testing.assert_allclose(0.5 * np.log(ratios).mean(axis=0), 0.0, atol=0.12)


def test_the_far_origins_covariance_is_that_of_its_arc(models: tuple[tp.ObjectModel, tp.ObjectModel]) -> None:
    _, far = models
    contacts = touch_surface(
        far, make_poses(X_PO[:, :3], X_PO[:, 3] - X_PO[:, :3] @ OFFSET), 3, np.random.default_rng(3)
    )
    best = tp.estimate_pose(far, contacts, prior=tp.PosePrior(RigidTransform(X_PO) @ RigidTransform(-OFFSET))).best
    middle = about_middle(best, far)
    u = np.random.default_rng(0).multivariate_normal(np.zeros(6), middle.covariance, 200_000)
    origins = transform_points(retract(middle.X_PO.GetAsMatrix34(), u), -far.middle[None])[:, 0]
    moved = origins - best.X_PO.translation()
    sampled = moved.T @ moved / len(moved)
    assert np.sqrt(np.trace(sampled)) > 0.03
    np.testing.assert_allclose(best.covariance[3:, 3:], sampled, atol=0.1 * np.trace(sampled))
    linear = middle.covariance[3:, 3:].trace()
    assert best.covariance[3:, 3:].trace() > linear


def test_a_free_turn_about_a_far_axis_stays_one_free_direction() -> None:
    mesh = trimesh.creation.cylinder(radius=0.03, height=0.12, sections=96)
    mesh.apply_translation(OFFSET)
    model = tp.ObjectModel.from_mesh(mesh, cache=False)
    contacts = touch_surface(model, make_poses(np.eye(3), -OFFSET), 6, np.random.default_rng(0))
    estimate = tp.estimate_pose(model, contacts)
    (free,) = estimate.best.free_directions
    assert np.linalg.norm(free) == pytest.approx(1.0)
    # The turn that leaves the cylinder's middle where it is.
    v_middle = free[3:] - estimate.best.X_PO.rotation().matrix() @ np.cross(OFFSET, free[:3])
    assert np.linalg.norm(v_middle) < 1e-2 * np.linalg.norm(free[:3])
    assert "slide along" in free_line(estimate.best)  # of the far origin
    assert free_line(about_middle(estimate.best, model)) == "Not determined by the touch: turn about the object's z."


def test_evidence_does_not_hang_on_where_the_origin_is(models: tuple[tp.ObjectModel, tp.ObjectModel]) -> None:
    contacts = touch_surface(models[0], X_PO, 6, np.random.default_rng(3))
    near, far = (tp.identify([model], contacts).identities[0] for model in models)
    assert far.log_evidence == pytest.approx(near.log_evidence, abs=0.2)
    assert near.estimate is not None
    assert far.estimate is not None
    X_near, X_far = near.estimate.best.X_PO, far.estimate.best.X_PO @ RigidTransform(OFFSET)
    assert X_far.IsNearlyEqualTo(X_near, 0.01)
