import numpy as np
import pytest

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.poses import increments_between, random_rotations
from tactopose_drake.core.shape.free_spin import turn_toward
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.synthetic.synthetic_touch import touch_surface
from tactopose_drake.estimation.descriptions import direction_names
from tactopose_drake.estimation.estimate import estimate_pose
from tests.core.meshes import create, scanned_can


@pytest.fixture(scope="module")
def touches() -> list[tuple[np.ndarray, int]]:
    generator = np.random.default_rng(7)
    return [
        (np.column_stack([R, generator.normal(size=3) * 0.05]), seed)
        for seed, R in enumerate(random_rotations(generator, 6))
    ]


def test_the_spin_of_a_scanned_can_is_one_hypothesis_with_the_turn_named(
    touches: list[tuple[np.ndarray, int]],
) -> None:
    model = ObjectModel.from_mesh(scanned_can())
    named = 0
    for X_PO, seed in touches:
        contacts = touch_surface(model, X_PO, 8, np.random.default_rng(seed))
        one = estimate_pose(model, contacts)
        assert sum(h.probability for h in one.hypotheses) == pytest.approx(1.0)
        assert sum(h.probability > 0.02 for h in one.hypotheses) <= 2  # upright and upside down
        named += direction_names(one.best) == ["turn about the object's z"]
        # Across the turn one of them is where the can is, by its own account.
        X_hat = np.array([h.X_PO.GetAsMatrix34() for h in one.hypotheses])
        off = increments_between(np.broadcast_to(X_PO, X_hat.shape), turn_toward(X_hat, X_PO, model.near_symmetries))
        spread = np.array([h.covariance for h in one.hypotheses])
        assert np.einsum("ni,ni->n", off, np.linalg.solve(spread, off[..., None])[..., 0]).min() < 20.0
    assert named >= 4


def test_images_of_a_nearly_square_box_keep_their_own_probabilities_where_the_touch_tells_them_apart() -> None:
    box = ObjectModel.from_mesh(create.box((0.05, 0.0504, 0.12)))
    assert len(box.symmetry_poses) == 8

    def touch(half_x: float, half_y: float) -> Contacts:
        rows = [([x, y, z], [np.sign(x), 0, 0]) for x in (-half_x, half_x) for y, z in ((0.0, 0.04), (0.01, -0.04))]
        rows += [([x, y, z], [0, np.sign(y), 0]) for y in (-half_y, half_y) for x, z in ((0.0, 0.04), (0.01, -0.04))]
        points, normals = zip(*rows, ([0.0, 0.0, 0.06], [0, 0, 1]), strict=True)
        return Contacts(np.array(points), np.array(normals, dtype=np.float64), sigma_position=1e-4)

    sure = estimate_pose(box, touch(0.025, 0.0252), outlier_probability=0.0)
    assert len(sure.hypotheses) == 2
    assert 0.9 < sure.best.probability < 1.0
    x_axis = sure.best.X_PO.rotation().matrix()[:, 0]
    assert abs(x_axis[0]) > 0.99  # of the two images the one whose shorter side is along x
    unsure = estimate_pose(box, touch(0.0251, 0.0251), outlier_probability=0.0)
    assert len(unsure.hypotheses) == 1
    assert unsure.status == "ok"
