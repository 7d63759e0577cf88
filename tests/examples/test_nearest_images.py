import numpy as np
import pytest

import tactopose_drake as tp
from tactopose_drake.core.poses import compose, exp_so3, increments_between, make_poses, random_rotations, retract
from tactopose_drake.resources import model_path
from tests.examples.scripts import load_script


@pytest.mark.parametrize("name", ["wine_glass", "pencil", "bust"])
def test_the_distance_is_to_the_nearest_image(name: str) -> None:
    nearest_increments = load_script("nearest_images.py").nearest_increments
    model = tp.ObjectModel.from_mesh(model_path("objects", f"{name}.obj"))
    generator = np.random.default_rng(0)
    X_PO = make_poses(random_rotations(generator, 1), np.zeros((1, 3)))[0]
    root = generator.normal(size=(6, 6)) / np.repeat([0.1, 0.01], 3)[:, None]
    information = root.T @ root
    near = retract(X_PO, 0.02 * generator.normal(size=6) * [1, 1, 1, 0.1, 0.1, 0.1])
    turns = model.symmetry_poses
    for symmetry in model.symmetries:
        if symmetry.is_continuous:
            R = exp_so3(np.linspace(0, 2 * np.pi, 3000)[:, None] * symmetry.axis)
            turns = make_poses(R, symmetry.point - R @ symmetry.point)
    images = compose(near, turns)
    u = increments_between(X_PO, images)
    least = np.einsum("bi,ij,bj->b", u, information, u).min()
    for truth in images[:: max(1, len(images) // 5)]:
        found = nearest_increments(model, X_PO, information, truth[None])[0]
        assert found @ information @ found == pytest.approx(least, rel=1e-3)
