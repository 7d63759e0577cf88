import numpy as np
import pytest

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.searches.pairs.pair_poses import contact_table
from tactopose_drake.core.shape.coarse_field import CoarseField, CoarseFieldParams, coarsen
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.synthetic.synthetic_touch import random_surface_points
from tests.coarse_costs import cost_at


def cost(field: CoarseField, contacts: Contacts, X_PO: np.ndarray, off: float = 0.0, turn: float = 0.0) -> float:
    table = contact_table(field, contacts, off, turn)
    return cost_at(field, table, X_PO)


@pytest.mark.parametrize("params", [CoarseFieldParams(), CoarseFieldParams(max_voxels=20_000, steps=12.0)])
def test_a_voxel_holds_the_grids_distance_and_normal(blob: ObjectModel, params: CoarseFieldParams) -> None:
    field = coarsen(blob.grid, params)
    assert len(field.values) == np.prod(field.shape) < 1.6 * params.max_voxels
    assert field.step == field.spacing / params.steps
    i, j, k = np.meshgrid(*(np.arange(0, n, 7) for n in field.shape), indexing="ij")
    centers = field.origin + field.spacing * np.stack([i, j, k], axis=-1)
    values = field.values[(i * field.shape[1] + j) * field.shape[2] + k]
    distance = np.clip(blob.grid.distance(centers), -127 * field.step, 127 * field.step)
    np.testing.assert_allclose(values[..., 0] * field.step, distance, atol=0.6 * field.step)


def test_true_contacts_cost_little_and_others_much(blob: ObjectModel) -> None:
    p, n = random_surface_points(blob, 200, np.random.default_rng(0))
    contacts = Contacts(p, n)
    assert cost(blob.coarse_field, contacts, np.eye(3, 4)) / 200 < 1.0
    beside = np.column_stack([np.eye(3), [0.02, 0.0, 0.0]])
    assert cost(blob.coarse_field, contacts, beside) / 200 > 20.0


@pytest.mark.parametrize("x", [0.3, -0.3])
def test_outside_of_the_grid_the_way_to_it_counts(blob: ObjectModel, x: float) -> None:
    contacts = Contacts([[x, 0.0, 0.0]])
    field = blob.coarse_field
    sigma = np.hypot(0.0009, field.spacing / np.sqrt(12))
    # Far off the bytes end at 21 voxels, but never before the grid does.
    found = np.sqrt(cost(field, contacts, np.eye(3, 4))) * sigma
    assert found == pytest.approx(float(blob.grid.distance([x, 0.0, 0.0])), abs=2 * field.spacing)


def test_inaccurate_poses_are_judged_more_mildly(blob: ObjectModel) -> None:
    p, n = random_surface_points(blob, 5, np.random.default_rng(0))
    beside = np.column_stack([np.eye(3), [0.005, 0.0, 0.0]])
    sharp = cost(blob.coarse_field, Contacts(p, n), beside)
    assert cost(blob.coarse_field, Contacts(p, n), beside, off=0.005, turn=0.2) < 0.2 * sharp
