"""Touches that say little, much, or nothing that fits: each ends soon, with an honest answer."""

import numpy as np
import pytest
import trimesh

import tactopose_drake as tp
from tactopose_drake.core.poses import increments_between, make_poses, random_rotations
from tactopose_drake.core.posterior.cramer_rao import cramer_rao_bound
from tactopose_drake.core.synthetic.synthetic_touch import touch_surface
from tactopose_drake.resources import model_path


@pytest.fixture(scope="module")
def objects() -> dict[str, tp.ObjectModel]:
    return {
        "mug": tp.ObjectModel.from_mesh(model_path("objects", "mug.obj")),
        "sphere": tp.ObjectModel.from_mesh(trimesh.creation.icosphere(subdivisions=3, radius=0.04)),
        "plate": tp.ObjectModel.from_mesh(trimesh.creation.box((0.2, 0.15, 0.003))),
    }


def check(estimate: tp.PoseEstimate) -> None:
    probability = np.array([hypothesis.probability for hypothesis in estimate.hypotheses])
    assert probability.sum() == pytest.approx(1.0)
    assert np.all(np.diff(probability) <= 0)
    for hypothesis in estimate.hypotheses:
        assert np.all(np.linalg.eigvalsh(hypothesis.covariance) > 0)
        assert np.isfinite(hypothesis.cost)


def touch(model: tp.ObjectModel, count: int, seed: int = 1) -> tuple[tp.Contacts, np.ndarray]:
    generator = np.random.default_rng(seed)
    X_PO = make_poses(random_rotations(generator, 1), 0.05 * generator.normal(size=(1, 3)))[0]
    return touch_surface(model, X_PO, count, generator), X_PO


@pytest.mark.parametrize("has_prior", [True, False])
@pytest.mark.parametrize("count", [2, 50])
@pytest.mark.parametrize("name", ["mug", "sphere", "plate"])
def test_few_and_many_contacts_are_explained(
    objects: dict[str, tp.ObjectModel], name: str, count: int, has_prior: bool
) -> None:
    contacts, X_PO = touch(objects[name], count)
    estimate = tp.estimate_pose(objects[name], contacts, prior=tp.PosePrior(X_PO) if has_prior else None)
    check(estimate)
    assert estimate.status != "no_solution"
    if count == 2 and not has_prior:
        assert estimate.status == "ambiguous"


@pytest.mark.parametrize("has_prior", [True, False])
@pytest.mark.parametrize("name", ["mug", "sphere", "plate"])
def test_contacts_far_apart_have_no_solution(objects: dict[str, tp.ObjectModel], name: str, has_prior: bool) -> None:
    model, prior = objects[name], tp.PosePrior(np.eye(4)) if has_prior else None
    points, normals = np.array([[0, 0, 0], [3.0, 0, 0], [0, 4.0, 0], [0, 0, 5.0]]), np.eye(3)[[0, 0, 1, 2]]
    estimate = tp.estimate_pose(model, tp.Contacts(2.0 * model.size * points, normals), prior=prior)
    check(estimate)
    assert estimate.status == "no_solution"
    with pytest.raises(tp.TactoposeError, match="millimetres"):
        tp.estimate_pose(model, tp.Contacts(points * max(1.0, 5.0 * model.size), normals), prior=prior)


def test_a_spheres_centre_is_known_and_its_rotation_is_not(objects: dict[str, tp.ObjectModel]) -> None:
    contacts, X_PO = touch(objects["sphere"], 6)
    best = tp.estimate_pose(objects["sphere"], contacts).best
    assert np.linalg.norm(best.X_PO.translation() - X_PO[:, 3]) < 0.004
    spread = np.sqrt(np.diag(best.covariance))
    assert np.all(spread[:3] > 1.0)
    assert np.all(spread[3:] < 0.003)


def test_many_contacts_determine_the_pose_as_well_as_they_can(objects: dict[str, tp.ObjectModel]) -> None:
    contacts, X_PO = touch(objects["mug"], 50)
    estimate = tp.estimate_pose(objects["mug"], contacts)
    error = increments_between(estimate.best.X_PO.GetAsMatrix34(), X_PO)
    bound = cramer_rao_bound(objects["mug"], contacts, X_PO)
    assert estimate.status == "ok"
    assert error @ bound.information @ error < 30.0
    assert error @ np.linalg.inv(estimate.best.covariance) @ error < 30.0


@pytest.mark.parametrize("seed", range(4))
def test_fingertips_in_a_row_on_one_face_of_a_box_may_be_on_any(seed: int) -> None:
    tea_box, generator = tp.ObjectModel.from_mesh(model_path("objects", "tea_box.obj")), np.random.default_rng(seed)
    R = random_rotations(generator, 1)[0]
    p_RC = np.linspace([-0.033, 0, 0], [0.033, 0, 0], 4) + generator.normal(size=(4, 3)) * [0.003, 0.003, 0.0003]
    found = tp.estimate_pose(tea_box, tp.Contacts(p_RC @ R.T, np.tile(R[:, 2], (4, 1))))
    faces = [int(np.argmax(np.abs(h.X_PO.rotation().matrix().T @ R[:, 2]))) for h in found.hypotheses]
    assert set(faces) == {0, 1, 2}
    assert found.status == "ambiguous"
    assert 0.3 < found.hypotheses[0].probability < 0.9
