import dataclasses

import numpy as np
import pytest
import trimesh

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.evidence.gaussian_prior import GaussianPrior
from tactopose_drake.core.grasping.quality import force_closure_probability, grasp_quality, lever, on_surface
from tactopose_drake.core.poses import inverse, make_poses, random_rotations, transform_points
from tactopose_drake.core.posterior.gaussian_mixture import GaussianMixture
from tactopose_drake.core.posterior.moved_origin import mixture_of_origin
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.errors import InvalidInputError, UnknownNameError
from tactopose_drake.estimation.estimate import estimate_pose

EXTENTS = (0.06, 0.08, 0.12)
# Thumb against three fingers.
P_OC = np.array([[0.03, 0.005, 0.0], [-0.03, -0.02, 0.03], [-0.03, 0.02, 0.02], [-0.03, 0.0, -0.04]])
SMALL = {"max_grid_bytes": 3_200_000, "symmetry": "none", "samples": 300}


@pytest.fixture(scope="module")
def box() -> ObjectModel:
    return ObjectModel.from_mesh(trimesh.creation.box(EXTENTS), **SMALL)  # type: ignore[arg-type]


@pytest.fixture
def X_PO() -> np.ndarray:
    return make_poses(random_rotations(np.random.default_rng(4), 1), np.array([[0.02, -0.1, 0.3]]))[0]


def held(X_PO: np.ndarray, p_OC: np.ndarray = P_OC) -> Contacts:
    return Contacts(transform_points(X_PO, p_OC))


@pytest.mark.parametrize("norm", ["L1", "Linf"])
def test_moving_the_palm_changes_nothing(box: ObjectModel, X_PO: np.ndarray, norm: str) -> None:
    contacts = P_OC if norm == "L1" else P_OC[:3]
    here = grasp_quality(box, Contacts(contacts), np.eye(3, 4), friction=0.6, norm=norm, task="object")
    there = grasp_quality(box, held(X_PO, contacts), X_PO, friction=0.6, norm=norm, task="object")
    assert here.force_closure
    assert here.radius > 0.01
    assert there.radius == pytest.approx(here.radius, rel=1e-5)
    assert there.task_scale == pytest.approx(here.task_scale, rel=1e-5)
    if norm == "L1":
        assert there.volume == pytest.approx(here.volume, rel=1e-5)


def test_moving_the_objects_own_frame_changes_no_more_than_the_cones_edges(box: ObjectModel, X_PO: np.ndarray) -> None:
    moved = trimesh.creation.box(EXTENTS)
    moved.apply_transform(np.vstack([X_PO, [0, 0, 0, 1]]))
    edges = 24
    here = grasp_quality(box, Contacts(P_OC), np.eye(3, 4), friction=0.6, edges=edges)
    model = ObjectModel.from_mesh(moved, **SMALL)  # type: ignore[arg-type]
    there = grasp_quality(model, Contacts(P_OC), inverse(X_PO), friction=0.6, edges=edges)
    assert there.radius == pytest.approx(here.radius, rel=1.1 * (1 - np.cos(np.pi / edges)) + 2e-3)
    assert there.length == pytest.approx(here.length)


def test_a_quality_cannot_be_written(box: ObjectModel) -> None:
    contacts = Contacts(P_OC)
    made = grasp_quality(box, contacts, np.eye(3, 4), friction=0.6)
    for array in (made.p_OC, made.n_OC, made.distance, made.space.primitives):
        assert not array.flags.writeable


def test_fingers_that_change_places_change_nothing(box: ObjectModel) -> None:
    here = grasp_quality(box, Contacts(P_OC), np.eye(3, 4), friction=0.6)
    swapped = grasp_quality(box, Contacts(P_OC[[2, 3, 0, 1]]), np.eye(3, 4), friction=0.6)
    assert swapped.radius == pytest.approx(here.radius, rel=1e-6)
    assert swapped.volume == pytest.approx(here.volume, rel=1e-6)
    # By a half turn of the box, which maps it, but not the grasp, onto itself.
    turned = grasp_quality(box, Contacts(P_OC * [-1, -1, 1]), np.eye(3, 4), friction=0.6)
    assert turned.radius == pytest.approx(here.radius, rel=1e-3)


def test_a_refined_mesh_changes_nothing(box: ObjectModel) -> None:
    fine = ObjectModel.from_mesh(trimesh.creation.box(EXTENTS).subdivide().subdivide(), **SMALL)  # type: ignore[arg-type]
    assert len(fine.faces) == 16 * len(box.faces)
    for norm, p_OC in (("L1", P_OC), ("Linf", P_OC[:3])):
        coarse_quality, fine_quality = (
            grasp_quality(model, Contacts(p_OC), np.eye(3, 4), friction=0.6, norm=norm) for model in (box, fine)
        )
        assert fine_quality.radius == pytest.approx(coarse_quality.radius, rel=1e-4)


def test_points_beside_the_surface_count_where_the_surface_is(box: ObjectModel) -> None:
    noise = np.random.default_rng(0).normal(scale=0.0009, size=P_OC.shape)
    noise[:, 1:] = 0.0
    exact = grasp_quality(box, Contacts(P_OC), np.eye(3, 4), friction=0.6)
    wrong_normals = np.tile([0.0, 0.0, 1.0], (4, 1))
    noisy = grasp_quality(box, Contacts(P_OC + noise, wrong_normals), np.eye(3, 4), friction=0.6)
    np.testing.assert_allclose(noisy.distance, noise[:, 0] * [1, -1, -1, -1], atol=2e-5)
    np.testing.assert_allclose(noisy.p_OC, P_OC, atol=2e-5)
    np.testing.assert_allclose(noisy.n_OC, exact.n_OC, atol=1e-4)
    assert noisy.radius == pytest.approx(exact.radius, rel=2e-3)


@pytest.mark.parametrize("thickness", [0.0002, 0.001, 0.002])
def test_a_measured_normal_says_which_side_of_a_card_is_held(thickness: float) -> None:
    """Noise brings a point nearer to the other side, where the finger would pull."""
    card = ObjectModel.from_box([0.085, 0.054, thickness])
    side = np.array([1.0, 1.0, 1.0, -1.0, -1.0])
    held_at = np.array([[0.02, 0.01], [-0.02, 0.01], [0.0, -0.02], [0.01, 0.0], [-0.015, -0.01]])
    n_PC = side[:, None] * np.array([[0.0, 0.0, 1.0]])
    noise = np.random.default_rng(0).normal(scale=0.0009, size=(50, 5))
    for z in 0.5 * thickness * side + noise:
        touched = Contacts(np.column_stack([held_at, z]), n_PC)
        quality = grasp_quality(card, touched, np.eye(3, 4), friction=0.5)
        assert quality.force_closure
        np.testing.assert_allclose(quality.n_OC, n_PC, atol=1e-3)
        np.testing.assert_allclose(quality.p_OC[:, 2], 0.5 * thickness * side, atol=2e-4)
        np.testing.assert_allclose(quality.distance, side * z - 0.5 * thickness, atol=4e-4)
    belief = GaussianMixture(np.eye(3, 4)[None], np.ones(1), np.diag([1e-6] * 3 + [1e-6] * 3)[None])
    assert force_closure_probability(card, touched, belief, friction=0.5, samples=50).value == 1.0


def test_points_far_off_are_moved_onto_the_surface(box: ObjectModel) -> None:
    points = np.random.default_rng(1).uniform(-0.09, 0.09, (200, 3))
    p_OC, n_OC, distance = on_surface(box, points)
    assert np.abs(box.grid.distance(p_OC[distance > 0])).max() < 1e-3
    np.testing.assert_allclose(np.linalg.norm(n_OC, axis=1), 1.0)


def test_a_heavier_load_needs_a_tighter_grip(box: ObjectModel, X_PO: np.ndarray) -> None:
    weight = np.array([[0.0, 0, 0, 0, 0, -1.0], [0.0, 0.02, 0, 0, 0, 0]])
    scales = [
        grasp_quality(box, held(X_PO), X_PO, friction=0.6, task=factor * weight).task_scale for factor in (1.0, 2.0)
    ]
    assert scales[0] == pytest.approx(2 * scales[1])
    # The task is in the palm's axes: turned with the grasp it is the same.
    R_PO = X_PO[:, :3]
    turned = (weight.reshape(-1, 2, 3) @ R_PO.T).reshape(-1, 6)
    here = grasp_quality(box, Contacts(P_OC), np.eye(3, 4), friction=0.6, task=weight)
    there = grasp_quality(box, held(X_PO), X_PO, friction=0.6, task=turned)
    assert there.task_scale == pytest.approx(here.task_scale, rel=1e-5)


def test_a_weight_is_carried_by_what_friction_can_carry(box: ObjectModel) -> None:
    # Opposite faces in line with the centre carry a weight along z by friction alone: with 1/2 N each, friction N. The
    # third finger makes it a grasp that also resists torque about the line.
    opposite = np.array([[0.03, 0.0, 0.0], [-0.03, 0.002, 0.0], [-0.03, -0.002, 0.0]])
    weight = [[0, 0, 0, 0, 0, -1.0]]
    quality = grasp_quality(box, Contacts(opposite), np.eye(3, 4), friction=0.5, edges=8, task=weight)
    assert quality.task_scale == pytest.approx(0.5, rel=1e-3)


def test_a_weight_on_fingers_from_below_is_carried_without_force_closure(box: ObjectModel) -> None:
    low = box.vertices[:, 2].min()
    below = Contacts([[0.02, 0.03, low], [-0.02, 0.03, low], [0.0, -0.03, low]])
    down, up = ([[0, 0, 0, 0, 0, force]] for force in (-1.0, 1.0))
    quality = grasp_quality(box, below, np.eye(3, 4), friction=0.5, task=down)
    assert not quality.force_closure
    assert quality.task_scale == pytest.approx(1.0, rel=1e-3)
    assert grasp_quality(box, below, np.eye(3, 4), friction=0.5, task=up).task_scale == 0.0


@pytest.mark.parametrize("length", [None, 0.01, 0.3])
def test_a_torque_is_resisted_by_forces_times_their_arms_in_whatever_units(
    box: ObjectModel, length: float | None
) -> None:
    # Two pairs of opposite fingers, each 1/4 N against a face, 20 mm from the axis that the torque is about: friction
    # holds it by 4 x 1/8 N at that arm, at the most, whatever torques are divided by.
    p_OC = np.array([[0.03, 0.02, 0.0], [0.03, -0.02, 0.0], [-0.03, 0.02, 0.0], [-0.03, -0.02, 0.0]])
    torque = [[1.0, 0, 0, 0, 0, 0]]
    quality = grasp_quality(box, Contacts(p_OC), np.eye(3, 4), friction=0.5, edges=8, length=length, task=torque)
    assert quality.task_scale == pytest.approx(4 * 0.25 * 0.5 * 0.02, rel=1e-3)


def test_too_few_contacts_hold_nothing(box: ObjectModel) -> None:
    for count in (0, 1, 2):
        quality = grasp_quality(box, Contacts(P_OC[:count].reshape(-1, 3)), np.eye(3, 4), friction=0.8, task="object")
        assert not quality.force_closure
        assert quality.radius == quality.volume == quality.task_scale == 0.0


def test_torques_are_scaled_by_the_objects_size(box: ObjectModel) -> None:
    assert lever(box) == pytest.approx(np.linalg.norm(EXTENTS) / 2)
    larger = ObjectModel.from_mesh(trimesh.creation.box(2 * np.array(EXTENTS)), **SMALL)  # type: ignore[arg-type]
    here = grasp_quality(box, Contacts(P_OC), np.eye(3, 4), friction=0.6)
    twice = grasp_quality(larger, Contacts(2 * P_OC), np.eye(3, 4), friction=0.6)
    assert twice.radius == pytest.approx(here.radius, rel=1e-3)
    given = grasp_quality(larger, Contacts(2 * P_OC), np.eye(3, 4), friction=0.6, length=lever(box))
    assert given.radius > 1.2 * twice.radius


def test_the_centre_of_mass_counts(box: ObjectModel) -> None:
    moved = dataclasses.replace(box, center_of_mass=np.array([0.0, 0.0, 0.05]))
    here, there = (
        grasp_quality(model, Contacts(P_OC), np.eye(3, 4), friction=0.6, length=0.07) for model in (box, moved)
    )
    assert there.radius < 0.8 * here.radius


def test_the_probability_is_the_share_of_the_poses_with_force_closure(box: ObjectModel) -> None:
    good = np.eye(3, 4)
    # So far off that all contacts are on the side that the palm sees.
    bad = make_poses(np.eye(3)[None], np.array([[-0.2, 0.0, 0.0]]))[0]
    contacts = Contacts(P_OC)
    assert not grasp_quality(box, contacts, bad, friction=0.6).force_closure
    belief = GaussianMixture(np.array([good, bad]), np.array([0.7, 0.3]), np.tile(1e-12 * np.eye(6), (2, 1, 1)))
    found = force_closure_probability(box, contacts, belief, friction=0.6, samples=400)
    assert abs(found.value - 0.7) < 4 * found.standard_error
    assert found.standard_error == pytest.approx(np.sqrt(0.21 / 400), rel=0.1)
    assert found == force_closure_probability(box, contacts, belief, friction=0.6, samples=400)
    assert found != force_closure_probability(box, contacts, belief, friction=0.6, samples=400, seed=1)


def test_where_the_frame_of_the_object_is_makes_a_grasp_no_less_sure(box: ObjectModel) -> None:
    mesh = trimesh.creation.box(EXTENTS)
    mesh.apply_translation([2.0, -1.0, 1.0])
    far = ObjectModel.from_mesh(mesh, **SMALL)  # type: ignore[arg-type]
    # The three fingers stay off the edges within the spread of the middle, not within that of the origin's arc.
    near = GaussianMixture(np.eye(3, 4)[None], np.ones(1), np.diag(np.repeat([0.1, 0.0005], 3) ** 2)[None])
    belief, contacts = mixture_of_origin(near, far.middle), Contacts(P_OC)
    values = [
        force_closure_probability(model, contacts, known, friction=0.4, samples=300).value
        for model, known in ((box, near), (far, belief))
    ]
    assert values[1] == pytest.approx(values[0], abs=0.05)


def test_the_less_is_known_the_less_sure_it_is(box: ObjectModel) -> None:
    # Contacts at two edges of the box are force closure or not by a few millimetres.
    p_OC = np.array([[0.03, 0.035, 0.0], [-0.03, 0.035, 0.03], [-0.03, 0.035, -0.03]])
    contacts = Contacts(p_OC)
    values = [
        force_closure_probability(
            box,
            contacts,
            GaussianMixture(np.eye(3, 4)[None], np.ones(1), np.diag([1e-12] * 3 + [sigma**2] * 3)[None]),
            friction=0.5,
            samples=300,
        ).value
        for sigma in (1e-6, 0.004, 0.02)
    ]
    assert values[0] == 1.0
    assert values[0] > values[1] > values[2] > 0.0


def test_impossible_arguments_are_refused(box: ObjectModel) -> None:
    contacts, X = Contacts(P_OC), np.eye(3, 4)
    with pytest.raises(InvalidInputError, match=r"friction must be .*, not -1"):
        grasp_quality(box, contacts, X, friction=-1.0)
    with pytest.raises(InvalidInputError, match=r"edges must be .*, not 2"):
        grasp_quality(box, contacts, X, friction=0.5, edges=2)
    with pytest.raises(InvalidInputError, match=r"length must be .*, not 0"):
        grasp_quality(box, contacts, X, friction=0.5, length=0.0)
    with pytest.raises(InvalidInputError, match="X_PO"):
        grasp_quality(box, contacts, np.eye(4)[:2], friction=0.5)
    for far in (1e300, 100.0):
        with pytest.raises(
            InvalidInputError, match=r"X_PO.translation must have coordinates from .* to 10 m, not \[.*\] m"
        ):
            grasp_quality(box, contacts, make_poses(np.eye(3), np.array([far, 0.0, 0.0])), friction=0.5)
    with pytest.raises(InvalidInputError, match=r"task must have the shape .*"):
        grasp_quality(box, contacts, X, friction=0.5, task=[1.0, 2.0])
    for nothing in (np.zeros((2, 6)), np.zeros((0, 6))):
        with pytest.raises(InvalidInputError, match="task must have at least one wrench that is not zero"):
            grasp_quality(box, contacts, X, friction=0.5, task=nothing)
    with pytest.raises(UnknownNameError, match="L1, Linf"):
        grasp_quality(box, contacts, X, friction=0.5, norm="L2")  # type: ignore[arg-type]
    with pytest.raises(UnknownNameError, match=r"must be one of .*, not 'gravity'"):
        grasp_quality(box, contacts, X, friction=0.5, task="gravity")  # type: ignore[arg-type]
    belief = GaussianMixture(X[None], np.ones(1), np.zeros((1, 6, 6)))
    with pytest.raises(InvalidInputError, match="seed must be an integer >= 0, not -1"):
        force_closure_probability(box, contacts, belief, friction=0.5, seed=-1)
    with pytest.raises(InvalidInputError, match=r"samples must be .*, not 0"):
        force_closure_probability(box, contacts, belief, friction=0.5, samples=0)
    with pytest.raises(InvalidInputError, match="belief must have 1 or more modes, not 0"):
        force_closure_probability(box, contacts, GaussianMixture.empty(), friction=0.5)


def test_an_estimate_says_what_is_believed() -> None:
    model = ObjectModel.from_mesh(trimesh.creation.box(EXTENTS), max_grid_bytes=3_200_000)
    n_OC = np.array([[1.0, 0, 0], [-1, 0, 0], [-1, 0, 0], [-1, 0, 0]])
    estimate = estimate_pose(model, Contacts(P_OC, n_OC), prior=GaussianPrior(np.eye(3, 4), 0.005, 0.1))
    belief = estimate.modes
    assert len(belief) == len(estimate.hypotheses)
    np.testing.assert_allclose(belief.weights, [hypothesis.probability for hypothesis in estimate.hypotheses])
    np.testing.assert_allclose(belief.X_PO[0], estimate.best.X_PO.GetAsMatrix34())
    np.testing.assert_allclose(belief.covariance[0], estimate.best.covariance)
    assert force_closure_probability(model, Contacts(P_OC), belief, friction=0.6, samples=50).value > 0.9


def test_a_quality_is_shown_in_one_short_line(box: ObjectModel) -> None:
    quality = grasp_quality(box, Contacts(P_OC), np.eye(3, 4), friction=0.5)
    assert repr(quality) == f"<GraspQuality: 4 contacts, force closure, radius {quality.radius:.3g}>"
