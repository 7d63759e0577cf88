import numpy as np
import pytest
import trimesh

from tactopose_drake.core.exploration.tolerance import Tolerance, merged_modes, nearest_twins, resolved_share
from tactopose_drake.core.poses import compose, exp_so3, make_poses, random_rotations, retract
from tactopose_drake.core.posterior.gaussian_mixture import GaussianMixture
from tactopose_drake.core.posterior.moved_origin import mixture_of_middle, mixture_of_origin
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.errors import InvalidInputError


@pytest.fixture(scope="module")
def can() -> ObjectModel:
    """A cylinder, whose spin about z and whose end that is up do not matter."""
    mesh = trimesh.creation.cylinder(radius=0.03, height=0.1, sections=96)
    return ObjectModel.from_mesh(mesh, max_grid_bytes=3_200_000, samples=300)


def mixture(X_PO: np.ndarray, weights: list[float], sigma: float, turn: float = 1e-4) -> GaussianMixture:
    covariance = np.diag([turn**2] * 3 + [sigma**2] * 3)
    return GaussianMixture(X_PO, np.array(weights), np.tile(covariance, (len(X_PO), 1, 1)))


def at(*places: tuple[float, float, float]) -> np.ndarray:
    return make_poses(np.tile(np.eye(3), (len(places), 1, 1)), np.array(places))


def test_modes_that_are_one_pose_are_made_one(can: ObjectModel) -> None:
    X_PO = at((0.0, 0.0, 0.0), (0.004, 0.0, 0.0), (0.03, 0.0, 0.0), (0.5, 0.0, 0.0))
    # The second lies upside down and has another spin.
    X_PO[1, :, :3] = exp_so3(np.array([np.pi, 0.0, 0.0])) @ exp_so3(np.array([0.0, 0.0, 1.0]))
    belief = mixture(X_PO, [0.3, 0.25, 0.446, 0.004], 0.001)
    joined = merged_modes(can, belief)
    np.testing.assert_allclose(joined.weights, np.array([0.55, 0.446]) / 0.996)
    np.testing.assert_allclose(joined.X_PO, X_PO[[0, 2]])
    # The spread of two modes 4 mm apart counts, beside their own.
    variance = 0.001**2 + (0.25 / 0.55) * 0.004**2
    assert joined.covariance[0, 3, 3] == pytest.approx(variance, rel=1e-6)


def test_what_is_joined_spreads_as_its_samples_do_about_the_nearest_twin() -> None:
    """Of modes that are turned by a right angle, and end for end about a middle that is not the frame's origin."""
    mesh = trimesh.creation.cylinder(radius=0.03, height=0.1, sections=96)
    mesh.apply_translation([0.0, 0.0, 0.05])
    can = ObjectModel.from_mesh(mesh, max_grid_bytes=3_200_000, samples=300)
    sigma, correlation = np.array([0.08, 0.01, 1e-4, 0.0005, 0.0005, 0.0005]), np.eye(6)
    # As by a touch far from the origin: what turns the object also moves that.
    correlation[[0, 4, 1, 3], [4, 0, 3, 1]] = 0.8, 0.8, -0.6, -0.6
    covariance = correlation * np.outer(sigma, sigma)
    turn = make_poses(exp_so3(np.array([0.0, 0.0, 0.5 * np.pi])), np.zeros(3))
    flip = make_poses(np.diag([1.0, -1.0, -1.0]), np.array([0.0, 0.0, 0.1]))
    X_PO = make_poses(random_rotations(np.random.default_rng(1), 1), np.array([[0.1, 0.0, 0.2]]))
    for image in (turn, flip, compose(flip, turn)):
        both = np.concatenate([X_PO, compose(X_PO, image[None])])
        belief = GaussianMixture(both, np.array([0.6, 0.4]), np.tile(covariance, (2, 1, 1)))
        joined = merged_modes(can, belief)
        assert len(joined) == 1
        drawn = belief.sample(10_000, np.random.default_rng(0))
        off = nearest_twins(can, drawn, joined.X_PO[0], Tolerance(translation=1.0, rotation=3.0)).increments
        sigmas = np.sqrt(np.diag(joined.covariance[0]))
        kept = [0, 1, 3, 4, 5]
        np.testing.assert_allclose(sigmas[kept], np.sqrt(np.mean(off**2, axis=0))[kept], rtol=0.1)
        scale = np.outer(sigmas, sigmas)[np.ix_(kept, kept)]
        sampled, told = (each[np.ix_(kept, kept)] / scale for each in (off.T @ off / len(off), joined.covariance[0]))
        np.testing.assert_allclose(told, sampled, atol=0.1)


def test_twins_are_nearest_by_what_symmetry_allows(can: ObjectModel) -> None:
    X_PO = at((0.009, 0.0, 0.0), (0.011, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    X_PO[:3, :, :3] = exp_so3(np.array([0.0, 0.0, 2.0]))
    X_PO[3, :, :3] = exp_so3(np.array([0.3, 0.0, 0.0]))
    twins = nearest_twins(can, X_PO, np.eye(3, 4), Tolerance())
    assert list(twins.same) == [True, False, True, False]
    np.testing.assert_allclose(twins.X_PO[2], np.eye(3, 4), atol=1e-4)
    np.testing.assert_allclose(twins.increments[3], [0.3, 0, 0, 0, 0, 0], atol=1e-3)


def test_one_wide_mode_does_not_pass_for_one_pose(can: ObjectModel) -> None:
    here = at((0.0, 0.0, 0.0))
    assert resolved_share(can, mixture(here, [1.0], 0.001)) == 1.0
    assert resolved_share(can, mixture(here, [1.0], 0.020)) < 0.1
    # A pose as wide as the tolerance says is within it at 95 %, in place and in direction each.
    sigmas = Tolerance().sigmas
    assert resolved_share(can, mixture(here, [1.0], sigmas[3])) == pytest.approx(0.95, abs=0.02)
    two = mixture(at((0.0, 0.0, 0.0), (0.1, 0.0, 0.0)), [0.7, 0.3], 0.001)
    assert resolved_share(can, two) == pytest.approx(0.7, abs=0.05)


def test_where_the_frame_of_an_object_is_changes_nothing(can: ObjectModel) -> None:
    """Of a mesh that was never moved to its frame, a turn of a degree moves the origin by centimetres."""
    p_OC = np.array([1.2, -0.3, 0.7])
    mesh = trimesh.Trimesh(can.vertices + p_OC, can.faces)
    far = ObjectModel.from_mesh(mesh, max_grid_bytes=3_200_000, samples=300)
    X_PC = at((0.0, 0.0, 0.1), (0.002, 0.0, 0.1), (0.05, 0.0, 0.1))
    X_PC[:, :, :3] = exp_so3(np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.5], [0.0, 0.3, 0.0]]))
    near = mixture(X_PC, [0.5, 0.3, 0.2], 0.002, turn=np.radians(3.0))
    belief = mixture_of_origin(near, far.middle)
    assert resolved_share(far, belief) == pytest.approx(resolved_share(can, near), abs=0.02)
    joined, expected = merged_modes(far, belief), merged_modes(can, near)
    np.testing.assert_allclose(joined.weights, expected.weights)
    back = mixture_of_middle(joined, far.middle)
    np.testing.assert_allclose(back.X_PO, expected.X_PO, atol=1e-6)
    np.testing.assert_allclose(back.covariance, expected.covariance, atol=1e-6)
    twins, of_can = (
        nearest_twins(far, belief.X_PO, belief.X_PO[0], Tolerance()),
        nearest_twins(can, X_PC, X_PC[0], Tolerance()),
    )
    np.testing.assert_array_equal(twins.same, of_can.same)
    np.testing.assert_allclose(compose(twins.X_PO, at(tuple(far.middle))), of_can.X_PO, atol=1e-3)
    np.testing.assert_allclose(retract(np.repeat(belief.X_PO[:1], 3, axis=0), twins.increments), twins.X_PO, atol=1e-9)


def test_bad_tolerances_and_beliefs_are_refused(can: ObjectModel) -> None:
    with pytest.raises(InvalidInputError, match=r"Tolerance\.rotation"):
        Tolerance(rotation=0.0)
    with pytest.raises(InvalidInputError, match="belief must have 1 or more modes, not 0"):
        resolved_share(can, GaussianMixture.empty())
