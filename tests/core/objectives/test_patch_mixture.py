import math

import numpy as np
import pytest

from tactopose_drake.core.evidence.contact_doubt import ContactKinds
from tactopose_drake.core.evidence.patch_contacts import patch_contacts
from tactopose_drake.core.objectives.patch_contact import PatchContact
from tactopose_drake.core.objectives.patch_mixture import PatchMixture
from tactopose_drake.core.poses import make_poses, random_rotations, retract, transform_points
from tactopose_drake.core.sensing.patches import Patch, describe_patch
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.synthetic.synthetic_patch import flat_pad, touch_with_pads
from tests.core.meshes import shape_poor_in_symmetry


@pytest.fixture(scope="module")
def model() -> ObjectModel:
    return ObjectModel.from_mesh(shape_poor_in_symmetry(), spacing=0.002, cache=False)


def touch(model: ObjectModel, seed: int, count: int = 4) -> tuple[np.ndarray, list[Patch]]:
    generator = np.random.default_rng(seed)
    X_PO = make_poses(random_rotations(generator, 1), 0.05 * generator.normal(size=(1, 3)))[0]
    return X_PO, list(touch_with_pads(model, X_PO, count, generator))


def moved(patch: Patch, way: float) -> Patch:
    """Away from the object along the pad's own normal."""
    X = make_poses(np.eye(3), -way * patch.n_PT.mean(axis=0))
    return describe_patch(transform_points(X, patch.p_PT), patch.pressure, alpha=patch.alpha, n_PT=patch.n_PT)


def near(X_PO: np.ndarray, count: int) -> np.ndarray:
    u = np.random.default_rng(0).normal(size=(count, 6)) * np.repeat([0.05, 0.002], 3)
    return retract(np.repeat(X_PO[None], count, axis=0), u)


def test_pads_as_told_count_as_they_do_without_doubt(model: ObjectModel) -> None:
    for seed in range(4):
        X_PO, patches = touch(model, seed)
        mixture, pads = PatchMixture(model, patches, 0.02), PatchContact(model.grid, patches)
        assert mixture.inlier_probability(X_PO[None]).min() > 0.9
        assert mixture.cost(X_PO[None]) == pytest.approx(pads.cost(X_PO[None]), abs=0.1)


def test_a_pad_on_something_else_costs_no_more_the_farther_it_is(model: ObjectModel) -> None:
    X_PO, patches = touch(model, 1)
    costs, shares = [], []
    for way in (0.0, 0.004, 0.03, 0.2):
        mixture = PatchMixture(model, [moved(patches[0], way), *patches[1:]], 0.02)
        costs.append(mixture.cost(X_PO[None])[0])
        shares.append(mixture.inlier_probability(X_PO[None])[0])
    assert costs[0] < costs[2] - 5.0
    assert costs[3] == pytest.approx(costs[2], abs=0.01)
    assert shares[0][0] > 0.9
    assert shares[3][0] < 1e-3
    np.testing.assert_allclose(shares[3][1:], shares[0][1:])


@pytest.mark.parametrize("scattered", [False, True])
def test_what_a_pad_on_something_else_costs_is_written_out(model: ObjectModel, scattered: bool) -> None:
    cells, generator = flat_pad(), np.random.default_rng(0)
    pressure = np.where(generator.random(len(cells)) < 0.5, 1.0, 9.0) * 4e3 if scattered else np.full(len(cells), 8e3)
    far = cells + np.array([0.0, 0.0, 0.5])
    pad = describe_patch(far, pressure, alpha=1e-7, n_PT=np.tile([0.0, 0.0, 1.0], (len(cells), 1)))
    felt = patch_contacts([pad])
    # On a plane its depths cost nothing; where they scatter more than any plane leaves, what noise makes of them.
    shape = 0.5 * (len(cells) - 3.0) if scattered else 0.0
    volume = np.prod(model.grid.upper - model.grid.origin + 2.0 * 0.05)
    density = model.area * math.sqrt(2.0 * math.pi) * felt.sigma_position[0] / volume * 0.5 * felt.sigma_normal[0] ** 2
    false, told = ContactKinds().shares(0.02).false, ContactKinds().shares(0.02).as_told
    turned = ContactKinds().shares(0.02).turned  # which leaves a pad as told, for it has no normal of its own
    expected = shape - math.log((false - turned) / (told + turned)) - math.log(density)
    assert PatchMixture(model, [pad], 0.02).cost(np.eye(3, 4)[None])[0] == pytest.approx(expected, rel=1e-9)


def test_the_derivatives_are_those_of_the_cost(model: ObjectModel) -> None:
    X_PO, patches = touch(model, 2)
    mixture = PatchMixture(model, [moved(patches[0], 0.006), *patches[1:]], 0.2)
    X = near(X_PO, 6)
    cost, gradient, hessian = mixture.normal_equations(X)
    np.testing.assert_allclose(cost, mixture.cost(X), rtol=1e-9)
    step = 1e-6
    close = 0
    for a in range(6):
        u = np.zeros((len(X), 6))
        u[:, a] = step
        numeric = (mixture.cost(retract(X, u)) - mixture.cost(retract(X, -u))) / (2.0 * step)
        close += np.count_nonzero(np.abs(numeric - gradient[:, a]) < 0.02 * np.abs(numeric) + 0.5)
    assert close >= 34  # But for creases of the pads' cost.
    assert np.linalg.eigvalsh(hessian).min() > -1e-6 * hessian.max()


def test_a_rarer_doubt_takes_more_to_be_believed(model: ObjectModel) -> None:
    X_PO, patches = touch(model, 3)
    patches[0] = moved(patches[0], 0.005)
    shares = [PatchMixture(model, patches, p).inlier_probability(X_PO[None])[0, 0] for p in (1e-6, 1e-3, 0.05, 0.3)]
    assert np.all(np.diff(shares) < 0.0)


def test_many_cells_of_as_much_noise_as_told_are_no_reason_to_doubt(model: ObjectModel) -> None:
    generator = np.random.default_rng(5)
    X_PO = make_poses(random_rotations(generator, 1), np.zeros((1, 3)))[0]
    patches = touch_with_pads(model, X_PO, 4, generator, sigma_depth=0.0005)
    assert PatchMixture(model, patches, 0.02).inlier_probability(X_PO[None]).min() > 0.5


def test_the_least_doubt_that_there_is_has_a_cost(model: ObjectModel) -> None:
    X_PO, pads = touch(model, 0)
    least = PatchMixture(model, pads, 5e-324)
    np.testing.assert_allclose(least.cost(X_PO[None]), PatchContact(model.grid, pads).cost(X_PO[None]))
