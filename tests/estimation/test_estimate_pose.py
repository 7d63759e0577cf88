import math

import numpy as np
import pytest
import trimesh
from pydrake.math import RigidTransform
from scipy.stats import chi2

import tactopose_drake as tp
from tactopose_drake.core.objectives.surface_contact import SurfaceContact
from tactopose_drake.core.poses import exp_so3, make_poses, transform_points
from tactopose_drake.core.searches.levenberg_marquardt import LevenbergMarquardt
from tactopose_drake.core.searches.pair_search import PairSearch
from tactopose_drake.core.searches.search import SearchResult, never
from tactopose_drake.core.synthetic.synthetic_touch import touch_surface
from tactopose_drake.estimation.descriptions import status_line
from tactopose_drake.estimation.inference import _Deadline
from tactopose_drake.resources import model_path
from tests.displaced_poses import displaced, error, random_pose

LOCAL_METHODS = ["levenberg_marquardt", "gradient_descent", "mathematical_program"]


@pytest.fixture(scope="module")
def box() -> tp.ObjectModel:
    return tp.ObjectModel.from_mesh(trimesh.creation.box((0.06, 0.09, 0.14)).subdivide().subdivide())


@pytest.fixture(scope="module")
def bottle() -> tp.ObjectModel:
    return tp.ObjectModel.from_mesh(model_path("objects", "spray_bottle.obj"))


def test_a_doubtful_prior_is_corrected(bottle: tp.ObjectModel) -> None:
    near = 0
    for seed in range(20):
        X_PO = random_pose(seed)
        contacts = touch_surface(bottle, X_PO, 5, np.random.default_rng(seed))
        estimate = tp.estimate_pose(bottle, contacts, prior=tp.PosePrior(displaced(X_PO, seed)))
        off = error(estimate, X_PO)
        near += np.linalg.norm(off[3:]) < 0.01 and np.linalg.norm(off[:3]) < math.radians(10)
    assert near >= 19


def test_a_touch_that_the_near_search_does_not_explain_is_looked_at_again(bottle: tp.ObjectModel) -> None:
    class Stuck(PairSearch):
        """Its starts lead nowhere, unless there are many."""

        def minimize(self, objective, space, generator, should_stop=never):  # type: ignore[no-untyped-def]
            if self.near_start.candidates > PairSearch.near_start.candidates:
                return super().minimize(objective, space, generator, should_stop)
            return SearchResult(space.center[None], objective.cost(space.center[None]), np.ones(1), np.ones(1, bool))

    X_PO = random_pose(3)
    contacts = touch_surface(bottle, X_PO, 5, np.random.default_rng(3))
    prior = tp.PosePrior(displaced(X_PO, 3))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("tactopose_drake.estimation.search_methods.PairSearch", Stuck)
        # Where contacts may be false, one such may explain where the starts lead.
        estimate = tp.estimate_pose(bottle, contacts, prior=prior, outlier_probability=0.0)
    assert estimate.best.explains_touch
    direct = tp.estimate_pose(bottle, contacts, prior=prior, outlier_probability=0.0).best
    off = error(estimate, direct.X_PO.GetAsMatrix34())
    assert off @ np.linalg.inv(direct.covariance) @ off < 1.0


@pytest.mark.parametrize("count", [3, 5])
def test_no_prior_is_needed(bottle: tp.ObjectModel, count: int) -> None:
    for seed in range(10):
        X_PO = random_pose(seed)
        contacts = touch_surface(bottle, X_PO, count, np.random.default_rng(seed))
        estimate = tp.estimate_pose(bottle, contacts)
        assert estimate.status in ("ok", "ambiguous")
        truth = LevenbergMarquardt().refine(SurfaceContact(bottle.grid, contacts), X_PO[None])
        assert min(h.cost for h in estimate.hypotheses) <= truth.cost[0] + 0.5


def test_ten_contacts_without_a_prior_find_the_pose(bottle: tp.ObjectModel) -> None:
    for seed in range(10):
        X_PO = random_pose(seed)
        estimate = tp.estimate_pose(bottle, touch_surface(bottle, X_PO, 10, np.random.default_rng(seed)))
        off = error(estimate, X_PO)
        assert np.linalg.norm(off[3:]) < 0.01
        assert np.linalg.norm(off[:3]) < math.radians(10)


def test_two_contacts_without_a_prior_are_ambiguous(bottle: tp.ObjectModel) -> None:
    contacts = touch_surface(bottle, random_pose(1), 2, np.random.default_rng(1))
    estimate = tp.estimate_pose(bottle, contacts)
    assert estimate.status == "ambiguous"
    assert estimate.best.cost < 5.0


@pytest.mark.parametrize("has_normals", [True, False])
@pytest.mark.parametrize("count", [1, 2, 5, 50])
def test_a_sphere_is_found_from_any_touch(count: int, has_normals: bool) -> None:
    ball = tp.ObjectModel.from_mesh(trimesh.creation.icosphere(subdivisions=4, radius=0.03))
    generator = np.random.default_rng(count)
    n_PC = generator.normal(size=(count, 3))
    n_PC /= np.linalg.norm(n_PC, axis=1, keepdims=True)
    estimate = tp.estimate_pose(ball, tp.Contacts([0.1, 0.2, 0.3] + 0.03 * n_PC, n_PC if has_normals else None))
    assert estimate.status == ("ambiguous" if count < 3 else "ok")
    if count >= 5:
        np.testing.assert_allclose(estimate.best.X_PO.translation(), [0.1, 0.2, 0.3], atol=1e-3)
    q = np.linalg.norm(0.03 * n_PC + [0.1, 0.2, 0.3] - estimate.best.X_PO.translation(), axis=1)
    np.testing.assert_allclose(q, 0.03, atol=2e-3)


def test_opposite_fingers_on_a_box_explain_themselves(box: tp.ObjectModel) -> None:
    p_PC = np.array([[0.03, 0.0, 0.0], [-0.03, 0.0, 0.0]])
    estimate = tp.estimate_pose(box, tp.Contacts(p_PC, np.sign(p_PC[:, :1]) * np.eye(3)[:1]))
    assert estimate.status == "ambiguous"
    assert estimate.best.cost < 0.5
    assert len(estimate.best.free_directions) == 3


def test_contacts_without_normals_need_no_prior_either(bottle: tp.ObjectModel) -> None:
    for seed in range(5):
        touched = touch_surface(bottle, random_pose(seed), 12, np.random.default_rng(seed))
        contacts = tp.Contacts(touched.p_PC)
        estimate = tp.estimate_pose(bottle, contacts)
        truth = LevenbergMarquardt().refine(SurfaceContact(bottle.grid, contacts), random_pose(seed)[None])
        assert min(h.cost for h in estimate.hypotheses) <= truth.cost[0] + 0.5


def test_contacts_metres_apart_have_no_solution(bottle: tp.ObjectModel) -> None:
    contacts = tp.Contacts([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], np.eye(3))
    assert tp.estimate_pose(bottle, contacts).status == "no_solution"


@pytest.mark.parametrize("method", LOCAL_METHODS)
def test_local_methods_correct_a_near_prior(blob: tp.ObjectModel, method: str) -> None:
    X_PO = random_pose(1)
    contacts = touch_surface(blob, X_PO, 6, np.random.default_rng(1))
    estimate = tp.estimate_pose(
        blob, contacts, prior=tp.PosePrior(displaced(X_PO, 2, translation=0.01, degrees=5.0)), method=method
    )
    assert len(estimate.hypotheses) == 1
    assert np.linalg.norm(error(estimate, X_PO)[3:]) < 0.005
    assert np.linalg.norm(error(estimate, X_PO)[:3]) < math.radians(6)


def test_touches_without_normals_count_by_distance(blob: tp.ObjectModel) -> None:
    X_PO = random_pose(4)
    touched = touch_surface(blob, X_PO, 8, np.random.default_rng(4))
    contacts = tp.Contacts(touched.p_PC)
    estimate = tp.estimate_pose(blob, contacts, prior=tp.PosePrior(displaced(X_PO, 4, 0.01, 5.0)))
    q = (contacts.p_PC - estimate.best.X_PO.translation()) @ estimate.best.X_PO.rotation().matrix()
    assert np.abs(blob.grid.distance(q)).max() < 0.003


def test_moving_the_palm_frame_moves_the_estimate(blob: tp.ObjectModel) -> None:
    X_PO, X_QP = random_pose(5), random_pose(6)
    contacts = touch_surface(blob, X_PO, 5, np.random.default_rng(5))
    assert contacts.n_PC is not None
    prior = tp.PosePrior(displaced(X_PO, 5))
    moved = tp.Contacts(transform_points(X_QP, contacts.p_PC), contacts.n_PC @ X_QP[:, :3].T)
    X_QO_prior = RigidTransform(X_QP).multiply(prior.X_PO)
    one = tp.estimate_pose(blob, contacts, prior=prior)
    other = tp.estimate_pose(blob, moved, prior=tp.PosePrior(X_QO_prior))
    expected = RigidTransform(X_QP).multiply(one.best.X_PO)
    off = error(other, expected.GetAsMatrix34())
    assert off @ np.linalg.inv(other.best.covariance) @ off < 0.5
    assert one.best.cost == pytest.approx(other.best.cost, abs=0.3)


def test_the_result_is_what_is_documented(blob: tp.ObjectModel) -> None:
    X_PO = random_pose(7)
    contacts = touch_surface(blob, X_PO, 5, np.random.default_rng(7))
    estimate = tp.estimate_pose(blob, contacts, prior=tp.PosePrior(displaced(X_PO, 7)), max_hypotheses=5)
    assert 1 <= len(estimate.hypotheses) <= 5
    assert sum(h.probability for h in estimate.hypotheses) == pytest.approx(1.0)
    assert estimate.best is estimate.hypotheses[0]
    assert all(
        a.probability >= b.probability for a, b in zip(estimate.hypotheses, estimate.hypotheses[1:], strict=False)
    )
    assert estimate.status in ("ok", "ambiguous")
    assert estimate.duration > 0
    assert isinstance(estimate.best.X_PO, RigidTransform)
    assert np.linalg.eigvalsh(estimate.best.covariance).min() > 0
    again = tp.estimate_pose(blob, contacts, prior=tp.PosePrior(displaced(X_PO, 7)), max_hypotheses=5)
    np.testing.assert_array_equal(again.best.X_PO.GetAsMatrix34(), estimate.best.X_PO.GetAsMatrix34())


def test_contacts_that_no_pose_explains_have_no_solution(blob: tp.ObjectModel) -> None:
    contacts = tp.Contacts([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], np.eye(3))
    estimate = tp.estimate_pose(blob, contacts, prior=tp.PosePrior(RigidTransform()))
    assert estimate.status == "no_solution"


def test_a_time_limit_cuts_the_search_short(bottle: tp.ObjectModel) -> None:
    contacts = touch_surface(bottle, random_pose(3), 5, np.random.default_rng(3))
    cut = tp.estimate_pose(bottle, contacts, time_limit=1e-9)
    assert not cut.finished
    assert "cut short" in repr(cut)
    assert "the time limit ended the search, which may have missed others" in status_line(cut)
    assert len(cut.hypotheses) >= 1
    whole = tp.estimate_pose(bottle, contacts, time_limit=60.0)
    assert whole.finished
    assert "cut short" not in repr(whole)
    assert "time limit" not in status_line(whole)
    # A mode's mean, which is its pose, may cost so much more than its minimum.
    assert min(h.cost for h in whole.hypotheses) <= min(h.cost for h in cut.hypotheses) + 0.3
    assert tp.estimate_pose(bottle, contacts).finished


def test_time_that_ends_while_it_is_looked_wider_leaves_the_modes_weighed(
    bottle: tp.ObjectModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked, limit = 0, math.inf

    def is_over(deadline: _Deadline) -> bool:
        nonlocal asked
        asked += 1
        deadline.passed = asked >= limit
        return deadline.passed

    monkeypatch.setattr(_Deadline, "__call__", is_over)
    contacts = tp.Contacts([[0.0, 0.0, 0.0], [0.5, 0.0, 0.0], [0.0, 0.5, 0.0]], np.eye(3))
    near = tp.PosePrior(RigidTransform())
    whole = tp.estimate_pose(bottle, contacts, prior=near)
    assert (whole.status, whole.finished) == ("no_solution", True)
    asked, limit = 0, asked  # As the wider search has ended.
    cut = tp.estimate_pose(bottle, contacts, prior=near)
    assert (cut.status, cut.finished) == ("no_solution", False)
    assert cut.standard_error < 0.05


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"method": "guess"}, "method must be one of pair_search, levenberg_marquardt.*, not 'guess'"),
        ({"contacts": tp.Contacts.empty()}, "contacts must be at least 1 if no patch is felt, not 0"),
        ({"max_hypotheses": 0}, "max_hypotheses must be .*, not 0"),
        ({"seed": -1}, "seed must be an integer >= 0, not -1"),
        ({"model": "mug.obj"}, "model must be an ObjectModel, not a str"),
        ({"time_limit": 0.0}, "time_limit must be a number > 0, not 0"),
        ({"time_limit": math.nan}, "time_limit must be .*, not nan"),
        (
            {"prior": None, "method": "levenberg_marquardt"},
            "prior must be a PosePrior for the method 'levenberg_marquardt', not None",
        ),
    ],
)
def test_bad_arguments_are_named_before_any_work(blob: tp.ObjectModel, change: dict[str, object], message: str) -> None:
    contacts, prior = tp.Contacts([[0, 0, 0]]), tp.PosePrior(np.eye(4))
    arguments: dict[str, object] = {"model": blob, "contacts": contacts, "prior": prior, **change}
    with pytest.raises(tp.TactoposeError, match=message):
        tp.estimate_pose(**arguments)  # type: ignore[arg-type]


def test_a_rotated_prior_is_no_obstacle(blob: tp.ObjectModel) -> None:
    # A half turn, where quaternion signs and rotation vectors jump.
    X_PO = make_poses(exp_so3(np.array([0.0, math.pi, 0.0])), np.zeros(3))
    contacts = touch_surface(blob, X_PO, 6, np.random.default_rng(10))
    estimate = tp.estimate_pose(blob, contacts, prior=tp.PosePrior(displaced(X_PO, 10, 0.01, 5.0)))
    assert np.linalg.norm(error(estimate, X_PO)[3:]) < 0.005


def test_each_hypothesis_says_whether_it_explains_the_touch(bottle: tp.ObjectModel) -> None:
    contacts = touch_surface(bottle, random_pose(4), 5, np.random.default_rng(4))
    estimate = tp.estimate_pose(bottle, contacts)
    assert estimate.best.explains_touch
    # Without a prior the cost is the touch's alone. What costs more explains it where the surface as it is does, near a
    # kink of the field, or a contact that may be false. Two that are false of five cost no more than that.
    cheap = [h for h in estimate.hypotheses if 2 * h.cost <= chi2.isf(1e-6, 3 * len(contacts))]
    assert cheap
    assert all(h.explains_touch == (np.count_nonzero(h.inlier_probability < 0.5) < 2) for h in cheap)
    apart = tp.Contacts([[0.0, 0, 0], [5.0, 0, 0], [0, 5.0, 0]], np.eye(3))
    assert not any(h.explains_touch for h in tp.estimate_pose(bottle, apart).hypotheses)
