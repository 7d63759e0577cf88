import math

import numpy as np
import pytest

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.evidence.patch_contacts import patch_contacts, with_patches
from tactopose_drake.core.objectives.patch_contact import PatchContact
from tactopose_drake.core.objectives.surface_contact import SurfaceContact
from tactopose_drake.core.poses import exp_so3, increments_between, make_poses, random_rotations
from tactopose_drake.core.searches.pair_search import PairSearch
from tactopose_drake.core.searches.touch_space import TouchSpace
from tactopose_drake.core.sensing.patches import Patch, describe_patch
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.synthetic.synthetic_patch import flat_pad, touch_with_pads
from tactopose_drake.errors import InvalidInputError
from tests.core.meshes import shape_poor_in_symmetry

ALPHA = 1e-7
OUT = np.tile([0.0, 0.0, -1.0], (24, 1))


def pressed(depth: np.ndarray) -> Patch:
    return describe_patch(flat_pad(), depth / ALPHA, alpha=ALPHA, n_PT=OUT)


def test_an_area_has_its_own_normal_and_the_others_the_pads() -> None:
    leaning = pressed(0.001 + 0.05 * flat_pad()[:, 0])
    row = pressed(np.where(np.arange(24) % 3 == 0, 0.001 + 0.05 * flat_pad()[:, 0], 0.0))
    point = pressed(np.where(np.arange(24) == 5, 0.001, 0.0))
    contacts = patch_contacts([leaning, pressed(np.zeros(24)), row, point], sigma_lean=0.4)
    assert [patch.status for patch in (leaning, row, point)] == ["area", "row", "point"]
    assert contacts.n_PC is not None
    np.testing.assert_allclose(contacts.p_PC, [leaning.centroid, row.centroid, point.centroid])
    np.testing.assert_allclose(contacts.n_PC[0] / contacts.n_PC[0, 2], [-0.05, 0.0, 1.0], atol=1e-12)
    np.testing.assert_allclose(contacts.n_PC[1:], -OUT[:2])
    np.testing.assert_allclose(np.asarray(contacts.sigma_normal)[1:], 0.4)
    assert len(patch_contacts([])) == 0


@pytest.mark.parametrize("turn", [0.0, 0.3])
def test_cells_that_look_every_way_are_a_contact_where_they_are_pressed_most(turn: float) -> None:
    """A finger in a slot, whose cells are on both of its sides."""
    side = flat_pad(3, 3) + np.array([0.0, 0.0, 0.004])
    cells, n_PT = np.vstack([side, side * [1, 1, -1]]), np.repeat([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]], 9, axis=0)
    R = exp_so3(np.array([turn, 0.0, 0.0]))
    depth = np.where(np.arange(18) == 13, 0.0012, 0.001)
    patch = describe_patch(cells @ R.T, depth / ALPHA, alpha=ALPHA, n_PT=n_PT @ R.T)
    assert patch.status == "narrow"
    assert np.isnan(patch.inward).all()
    contacts = patch_contacts([patch], sigma_lean=0.4)
    np.testing.assert_allclose(contacts.p_PC, [R @ (cells[13] + [0.0, 0.0, 0.0012])], atol=1e-12)
    np.testing.assert_allclose(contacts.n_PC, [R[:, 2]], atol=1e-12)
    assert np.asarray(contacts.sigma_normal) == pytest.approx(0.4)


def test_where_the_palm_s_frame_is_decides_nothing_of_how_sure_a_pad_s_place_is() -> None:
    """A pad turns about the middle of its cells."""
    root = np.random.default_rng(3).normal(size=(6, 6)) * np.repeat([0.001, 0.05], 3)[:, None]
    X_PQ = make_poses(random_rotations(np.random.default_rng(4), 1), np.array([[0.2, -0.4, 0.3]]))[0]
    twice = np.kron(np.eye(2), X_PQ[:, :3])
    depth, near, far = np.where(np.arange(24) < 8, 0.001 + 0.02 * flat_pad()[:, 0], 0.0), np.eye(3, 4), X_PQ
    sigmas = []
    for X, turn in ((near, np.eye(6)), (far, twice)):
        cells, n_PT = flat_pad() @ X[:, :3].T + X[:, 3], OUT @ X[:, :3].T
        misplacement = turn @ root @ root.T @ turn.T
        patch = describe_patch(cells, depth / ALPHA, alpha=ALPHA, n_PT=n_PT, misplacement=misplacement)
        contacts = patch_contacts([patch])
        sigmas.append([float(np.asarray(contacts.sigma_position)[0]), float(np.asarray(contacts.sigma_normal)[0])])
    np.testing.assert_allclose(sigmas[1], sigmas[0], rtol=1e-9)


def test_the_spread_of_an_areas_normal_is_what_it_claims() -> None:
    generator, sigma, turn = np.random.default_rng(0), 0.0004, 0.05
    tilts, claims = [], []
    for _ in range(400):
        patch = pressed(0.003 + sigma * generator.normal(size=24))
        contacts = patch_contacts([patch], sigma_depth=sigma, sigma_rotation=turn)
        assert contacts.n_PC is not None
        # About the long axis of the pad, x, as it is measured by a pad that is turned.
        tilts.append((exp_so3(generator.normal(size=3) * turn) @ contacts.n_PC[0])[1])
        claims.append(np.asarray(contacts.sigma_normal)[0])
    assert np.std(tilts) == pytest.approx(np.mean(claims), rel=0.1)
    assert np.mean(claims) > 1.2 * turn


def test_no_area_tells_its_normal_worse_than_a_pad_that_may_lean() -> None:
    leans = [0.01, 0.2, 3.0]
    area = pressed(0.001 + 0.05 * flat_pad()[:, 0])
    found = [float(patch_contacts([area], sigma_depth=0.01, sigma_lean=lean).sigma_normal[0]) for lean in leans]
    assert found[:2] == pytest.approx(leans[:2])
    assert 0.2 < found[2] < 3.0


def test_a_pad_that_says_how_far_it_is_misplaced_is_as_sure_as_that() -> None:
    """Against errors that are drawn: of where the centroid is, far from the middle of the cells, and of its normal."""
    generator = np.random.default_rng(3)
    near_an_end = np.where(flat_pad()[:, 0] > 0.003, 0.001 + 0.05 * flat_pad()[:, 0], 0.0)
    root = np.tril(generator.normal(size=(6, 6))) * np.repeat([0.0005, 0.1], 3)[:, None]
    root[3:, :3] += 0.2 * np.eye(3)[[1, 2, 0]]  # shifts and turns belong together
    misplacement = root @ root.T
    told, known, unknown = (
        describe_patch(flat_pad(), near_an_end / ALPHA, alpha=ALPHA, n_PT=OUT, misplacement=each)
        for each in (misplacement, 1e-14 * np.eye(6), None)
    )
    contacts, best, assumed = (patch_contacts([patch], sigma_rotation=0.06) for patch in (told, known, unknown))
    assert told.status == "area"
    draws = generator.normal(size=(200_000, 6)) @ root.T
    arm = told.centroid - flat_pad().mean(axis=0)
    off = draws[:, :3] + np.cross(draws[:, 3:], arm)
    assert np.sqrt(np.mean(off**2)) > 1.2 * np.sqrt(np.mean(draws[:, :3] ** 2))
    np.testing.assert_allclose(contacts.sigma_position, np.sqrt(np.mean(off**2)), rtol=0.01)
    bend = np.square(assumed.sigma_normal) - 0.06**2  # of the cells' depths, which does not depend on the pad
    turned = np.sqrt(np.mean(draws[:, 3:] ** 2) + bend)
    np.testing.assert_allclose(contacts.sigma_normal, turned, rtol=0.01)
    # No pad is known so well that a contact would be exact.
    np.testing.assert_allclose(best.sigma_position, 1e-5)
    assert np.all(np.square(best.sigma_normal) > bend)


@pytest.mark.parametrize("name", ["sigma_depth", "sigma_position", "sigma_rotation", "sigma_lean"])
@pytest.mark.parametrize("value", [0.0, -1.0, math.nan])
def test_a_sigma_that_is_none_is_named(name: str, value: float) -> None:
    with pytest.raises(InvalidInputError, match=f"{name} must be .*, not {value:g}"):
        patch_contacts([pressed(np.full(24, 0.001))], **{name: value})


@pytest.mark.parametrize("has_normals", [True, False])
def test_joined_they_say_what_contacts_and_patches_say(has_normals: bool) -> None:
    model = ObjectModel.from_mesh(shape_poor_in_symmetry())
    generator = np.random.default_rng(2)
    n_PC = random_rotations(generator, 5)[:, 0] if has_normals else None
    contacts = Contacts(0.03 * generator.normal(size=(5, 3)), n_PC, sigma_position=np.linspace(0.001, 0.002, 5))
    patches = [pressed(np.full(24, 0.001)), pressed(np.zeros(24)), pressed(0.001 + 0.05 * flat_pad()[:, 0])]
    X_PO = make_poses(random_rotations(generator, 20), 0.02 * generator.normal(size=(20, 3)))
    apart = [SurfaceContact(model.grid, some).cost(X_PO) for some in (contacts, patch_contacts(patches))]
    joined = with_patches(contacts, patches)
    assert len(joined) == 7
    np.testing.assert_allclose(SurfaceContact(model.grid, joined).cost(X_PO), sum(apart), rtol=0.0, atol=1e-3)
    assert with_patches(contacts, patches[1:2]) is contacts
    np.testing.assert_array_equal(with_patches(Contacts.empty(), patches).p_PC, patch_contacts(patches).p_PC)


def test_they_lead_a_search_to_the_pose() -> None:
    model = ObjectModel.from_mesh(shape_poor_in_symmetry())
    near = 0
    for seed in range(5):
        generator = np.random.default_rng(seed)
        X_PO = make_poses(random_rotations(generator, 1), 0.05 * generator.normal(size=(1, 3)))[0]
        patches = touch_with_pads(model, X_PO, 5, generator)
        contacts = patch_contacts(patches)
        search, space = PairSearch(model=model, contacts=contacts), TouchSpace(model, contacts)
        found = search.minimize(PatchContact(model.grid, patches), space, np.random.default_rng(0))
        off = increments_between(found.X_PO[:1], X_PO[None])[0]
        near += np.linalg.norm(off[:3]) < math.radians(10.0) and np.linalg.norm(off[3:]) < 0.01
    assert near >= 4
