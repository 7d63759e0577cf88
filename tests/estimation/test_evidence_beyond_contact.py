"""What the hand's volume, silent fingertips, balance and friction add to a touch."""

import math

import numpy as np
import pytest
import trimesh

import tactopose_drake as tp
from tactopose_drake.core.evidence.evidence import Evidence
from tactopose_drake.core.objectives.plane_support import PlaneSupport
from tactopose_drake.core.objectives.surface_contact import SurfaceContact
from tactopose_drake.core.poses import increments_between, make_poses, random_rotations, transform_points
from tactopose_drake.core.searches.pair_search import PairSearch
from tactopose_drake.core.searches.pose_problem import make_problem
from tactopose_drake.core.synthetic import touch_surface, touch_with_pads
from tactopose_drake.errors import InvalidInputError
from tactopose_drake.estimation.search_methods import METHODS
from tests.core.balanced_forces import balanced_forces
from tests.displaced_poses import random_pose

TIP = 0.008  # radius of a fingertip, m
MASS = 0.3


@pytest.fixture(scope="module")
def can() -> tp.ObjectModel:
    return tp.ObjectModel.from_mesh(trimesh.creation.cylinder(radius=0.033, height=0.115, sections=64), mass=MASS)


@pytest.fixture(scope="module")
def box() -> tp.ObjectModel:
    return tp.ObjectModel.from_mesh(trimesh.creation.box((0.06, 0.09, 0.14)).subdivide().subdivide())


def fingertips(contacts: tp.Contacts, pressed: float = 0.0005) -> tp.HandGeometry:
    """The fingertips that make the contacts, pressed into their skin."""
    assert contacts.n_PC is not None
    return tp.HandGeometry(contacts.p_PC + (TIP - pressed) * contacts.n_PC, np.full(len(contacts), TIP))


def test_hand_and_friction_tell_inside_from_outside(box: tp.ObjectModel) -> None:
    # Points on a plane do not say which side of it is full; the fingers, and their forces, do.
    right = np.zeros(3, dtype=np.int64)
    generator = np.random.default_rng(0)
    for _ in range(20):
        X_PO = make_poses(random_rotations(generator, 1), np.zeros((1, 3)))[0]
        p_OC = np.column_stack([np.full(5, 0.03), generator.uniform(-0.04, 0.04, (5, 2))])
        n_PC = np.tile(X_PO[:, 0], (5, 1))
        touched = tp.Contacts(transform_points(X_PO, p_OC), n_PC, 2.0 * n_PC)
        points = tp.Contacts(touched.p_PC, f_PC=touched.f_PC)
        estimates = (
            tp.estimate_pose(box, points),
            tp.estimate_pose(box, points, hand=fingertips(touched)),
            tp.estimate_pose(box, points, friction=0.3),
        )
        right += [is_behind(box, estimate.best, touched) for estimate in estimates]
    assert right[0] < 17
    assert right[1] == right[2] == 20


def is_behind(model: tp.ObjectModel, hypothesis: tp.PoseHypothesis, contacts: tp.Contacts) -> bool:
    """Whether the object's middle is on the side of the contacts that their normals leave."""
    assert contacts.n_PC is not None
    middle = hypothesis.X_PO @ model.center_of_mass
    return bool(np.sum((middle - contacts.p_PC) * contacts.n_PC) < 0.0)


def test_fingers_that_merely_touch_change_nothing(blob: tp.ObjectModel) -> None:
    for seed in range(5):
        X_PO = random_pose(seed)
        exact = touch_surface(blob, X_PO, 8, np.random.default_rng(seed), sigma_position=0.0, sigma_normal=0.0)
        contacts = tp.Contacts(exact.p_PC, exact.n_PC)
        prior = tp.PosePrior(X_PO, 0.01, 0.1)
        alone = tp.estimate_pose(blob, contacts, prior=prior).best
        held = tp.estimate_pose(blob, contacts, prior=prior, hand=fingertips(contacts)).best
        apart = increments_between(alone.X_PO.GetAsMatrix34(), held.X_PO.GetAsMatrix34())
        assert apart @ np.linalg.solve(alone.covariance, apart) < 0.3**2
        assert held.cost == pytest.approx(alone.cost, abs=0.01)


def test_a_fingertip_that_feels_nothing_is_not_in_the_object(can: tp.ObjectModel) -> None:
    # Two fingers hold the can from the sides; a third hangs beside its upper half, where the can would be otherwise.
    contacts = tp.Contacts([[0.033, 0, 0], [-0.033, 0, 0]], [[1.0, 0, 0], [-1.0, 0, 0]])
    prior = tp.PosePrior(np.column_stack([np.eye(3), [0.0, 0.0, 0.02]]), sigma_translation=0.03)
    silent = tp.HandGeometry([[0.0, 0.0, 0.05]], [TIP])
    before = tp.estimate_pose(can, contacts, prior=prior).best.X_PO
    after = tp.estimate_pose(can, contacts, prior=prior, untouched=silent).best.X_PO
    depths = [TIP - float(can.grid.distance(X_PO.inverse() @ silent.p_PH[0])) for X_PO in (before, after)]
    assert depths[0] > 0.01
    assert depths[1] < 0.002


@pytest.mark.parametrize("evidence", ["hand", "untouched"])
def test_a_finger_in_the_way_bounds_a_slide_on_one_side_only(can: tp.ObjectModel, evidence: str) -> None:
    angles, heights = np.radians([100.0, 170.0, 240.0, 10.0]), np.array([0.0, 0.03, -0.02, 0.01])
    n_PC = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(4)])
    contacts = tp.Contacts(0.033 * n_PC + np.outer(heights, [0.0, 0.0, 1.0]), n_PC)
    prior = tp.PosePrior(np.column_stack([np.eye(3), [0.0, 0.0, 0.02]]), sigma_translation=0.03)
    stop = tp.HandGeometry([[0.0, 0.0, 0.05]], [TIP])
    alone = tp.estimate_pose(can, contacts, prior=prior).best
    stopped = tp.estimate_pose(can, contacts, prior=prior, **{evidence: stop}).best  # type: ignore[arg-type]
    assert stopped.X_PO.translation()[2] < alone.X_PO.translation()[2] - 0.01
    assert len(stopped.free_directions) == len(alone.free_directions) == 2
    # The bound's own curvature would say 1 mm.
    assert math.sqrt(stopped.covariance[5, 5]) > 0.003


@pytest.mark.parametrize(
    "method", ["pair_search", "levenberg_marquardt", "gradient_descent", "mathematical_program", "scaling_series"]
)
def test_balance_tells_how_far_a_can_has_slid(can: tp.ObjectModel, method: str) -> None:
    # The can lies along z, across gravity, between four fingers; vision has it 4 cm further along.
    gravity = tp.ForceBalance([-9.81, 0.0, 0.0])
    angles, heights = np.radians([100.0, 170.0, 240.0, 10.0]), np.array([0.0, 0.03, -0.02, 0.01])
    n_PC = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(4)])
    p_PC = 0.033 * n_PC + np.outer(heights, [0.0, 0.0, 1.0])
    f_PC = balanced_forces(2.0 * n_PC, p_PC, np.zeros(3), MASS * gravity.gravity_P)
    contacts = tp.Contacts(p_PC, n_PC, f_PC)
    prior = tp.PosePrior(np.column_stack([np.eye(3), [0.0, 0.0, 0.04]]), sigma_translation=0.05)
    slid = tp.estimate_pose(can, contacts, prior=prior, method=method).best
    held = tp.estimate_pose(can, contacts, prior=prior, method=method, balance=gravity, hand=fingertips(contacts)).best
    assert math.sqrt(slid.covariance[5, 5]) > 0.015
    assert abs(held.X_PO.translation()[2]) < 0.002
    assert (len(slid.free_directions), len(held.free_directions)) == (2, 1)
    assert math.sqrt(held.covariance[5, 5]) < 0.003


def test_forces_that_do_not_hold_the_weight_are_explained_by_no_pose(can: tp.ObjectModel) -> None:
    """One with the wrong sign, a mass in another unit, gravity the other way; not so by noise. All may not pull."""
    down, angles = np.array([-9.81, 0.0, 0.0]), np.radians([100.0, 170.0, 240.0, 10.0])
    n_PC = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(4)])
    p_PC = 0.033 * n_PC + np.outer([0.0, 0.03, -0.02, 0.01], [0.0, 0.0, 1.0])
    f_PC, prior = balanced_forces(2.0 * n_PC, p_PC, np.zeros(3), MASS * down), tp.PosePrior(np.eye(3, 4))

    def status(forces: np.ndarray, gravity: np.ndarray = down) -> str:
        contacts = tp.Contacts(p_PC, n_PC, forces, sigma_force=0.05)
        return tp.estimate_pose(can, contacts, prior=prior, balance=tp.ForceBalance(gravity)).status

    assert status(f_PC) == "ok"
    assert status(f_PC + 0.05 * np.random.default_rng(0).normal(size=(4, 3))) == "ok"
    reversed_one = np.where(np.arange(4)[:, None] == 2, -f_PC, f_PC)
    assert status(reversed_one) == status(f_PC, -down) == status(1000.0 * f_PC) == "no_solution"
    with pytest.raises(
        InvalidInputError, match=r"^contacts must have forces f_PC .*, not against them as in 0, 1, 2, 3"
    ):
        status(-f_PC)


def test_status_is_about_the_touch(blob: tp.ObjectModel) -> None:
    # A hand that fills all the room: no pose keeps out of it, but the touch is explained.
    contacts = touch_surface(blob, random_pose(1), 8, np.random.default_rng(1))
    everywhere = tp.HandGeometry(np.random.default_rng(2).uniform(-0.15, 0.15, (300, 3)), np.full(300, 0.02))
    estimate = tp.estimate_pose(blob, contacts, hand=everywhere)
    assert estimate.best.cost > tp.estimate_pose(blob, contacts).best.cost + 30.0
    assert estimate.best.explains_touch or estimate.status == "no_solution"
    apart = tp.Contacts([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], np.eye(3))
    assert tp.estimate_pose(blob, apart, hand=everywhere).status == "no_solution"


@pytest.mark.parametrize(
    ("evidence", "message"),
    [
        ({"balance": tp.ForceBalance([0.0, 0.0, -9.81])}, "contacts must have forces f_PC for the balance, not None"),
        ({"friction": 0.5}, "contacts must have forces f_PC for the friction, not None"),
        ({"friction": -0.5}, "friction must be a number >= 0, not -0.5"),
    ],
)
def test_evidence_that_does_not_fit_is_refused(blob: tp.ObjectModel, evidence: dict[str, object], message: str) -> None:
    with pytest.raises(tp.TactoposeError, match=message):
        tp.estimate_pose(blob, tp.Contacts([[0.0, 0.0, 0.0]]), **evidence)  # type: ignore[arg-type]


def test_a_table_tells_how_far_a_rod_has_slid() -> None:
    rod = tp.ObjectModel.from_mesh(trimesh.creation.cylinder(radius=0.012, height=0.16, sections=48), samples=600)
    height = np.array([-0.02, 0.0, 0.02, 0.01, -0.01])
    angle = np.array([0.0, 2.0, 4.0, 3.0, 5.0])
    n_PC = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(5)])
    contacts = tp.Contacts(0.012 * n_PC + height[:, None] * [0.0, 0.0, 1.0], n_PC)
    slid = 0.017
    table = tp.PlaneContact(np.array([0.1, 0.0, slid - 0.08]), np.array([0.0, 0.0, 1.0]), 0.0005)
    free, told = tp.estimate_pose(rod, contacts), tp.estimate_pose(rod, contacts, planes=[table])
    assert any(abs(row[5]) > 0.9 for row in free.best.free_directions), "the fingers leave the slide open"
    assert not any(abs(row[5]) > 0.5 for row in told.best.free_directions)
    assert told.best.X_PO.translation()[2] == pytest.approx(slid, abs=0.0015)
    assert math.sqrt(told.best.covariance[5, 5]) == pytest.approx(0.0005, rel=0.4)
    # A table that is elsewhere moves it there, and one that leans as well says no more than where the rim is.
    lower = tp.PlaneContact(table.p_PQ - [0.0, 0.0, 0.03], table.n_P, 0.0005)
    moved = tp.estimate_pose(rod, contacts, planes=[lower]).best.X_PO.translation()
    assert moved[2] == pytest.approx(slid - 0.03, abs=0.0015)


def test_one_contact_and_a_plane_leave_many_poses(can: tp.ObjectModel) -> None:
    contact = touch_surface(can, np.eye(3, 4), 1, np.random.default_rng(0))
    table = tp.PlaneContact([0.0, 0.0, -0.06], [0.0, 0.0, 1.0])
    alone, beside = (METHODS["pair_search"](can, Evidence(contact, planes=planes)) for planes in ((), (table,)))
    assert isinstance(alone, PairSearch)
    assert isinstance(beside, PairSearch)
    assert beside.start.samples >= 4 * alone.start.samples
    assert beside.on_the_way.kept > alone.on_the_way.kept
    # All starts reach the plane before most of them are dropped.
    objective = make_problem(can, Evidence(contact, planes=(table,))).objective
    assert [type(term) for term in objective.quick.terms] == [SurfaceContact, PlaneSupport]


def test_a_pose_that_pads_keep_off_a_plane_explains_no_touch(can: tp.ObjectModel) -> None:
    X_PO, lowest = np.eye(3, 4), np.array([0.0, 0.0, can.vertices[:, 2].min()])
    pads = touch_with_pads(can, X_PO, 3, np.random.default_rng(0))
    prior = tp.PosePrior(X_PO, sigma_translation=0.002, sigma_rotation=0.05)
    for off, status in ((0.0, "ok"), (0.015, "no_solution")):
        table = tp.PlaneContact(lowest - [0.0, 0.0, off], [0.0, 0.0, 1.0])
        estimate = tp.estimate_pose(can, tp.Contacts.empty(), patches=pads, prior=prior, planes=[table])
        assert estimate.status == status


@pytest.mark.parametrize("height", [0.2, 0.5, 5.0])
def test_a_plane_that_nothing_can_reach_leaves_no_pose_far_away(can: tp.ObjectModel, height: float) -> None:
    # Without contacts, all of which are then false, nothing holds the pose along the plane.
    contacts = touch_surface(can, np.eye(3, 4), 5, np.random.default_rng(0))
    estimate = tp.estimate_pose(can, contacts, planes=[tp.PlaneContact([0.0, 0.0, height], [0.0, 0.0, 1.0])])
    assert estimate.status == "no_solution"
    for hypothesis in estimate:
        assert np.linalg.norm(hypothesis.X_PO.translation()) < 1.0
        assert np.sqrt(np.diag(hypothesis.covariance)).max() < 10.0
