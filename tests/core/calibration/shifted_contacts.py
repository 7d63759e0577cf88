"""Contacts that an unknown shift moves in every grasp."""

import numpy as np

from tactopose_drake.core.calibration.shared_least_squares import SharedProblem
from tactopose_drake.core.calibration.surface_residuals import ContactSigmas, GraspContacts
from tactopose_drake.core.poses import make_poses, random_rotations, transform_points
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.synthetic.synthetic_touch import random_surface_points

GRASPS, CONTACTS = 8, 6
SIGMA = 0.004  # of the shift of the first finger's contacts along each axis, m


class Shifted:
    """Grasps by six fingers, of which the first is elsewhere than told."""

    def __init__(self, model: ObjectModel, shift: np.ndarray, noise: float = 0.0, seed: int = 0) -> None:
        generator = np.random.default_rng(seed)
        self.X_PO = make_poses(random_rotations(generator, GRASPS), 0.03 * generator.normal(size=(GRASPS, 3)))
        p_O, _ = random_surface_points(model, GRASPS * CONTACTS, generator)
        for _ in range(5):
            phi, n_O = model.grid.distance_and_normal(p_O)
            p_O = p_O - phi[:, None] * n_O
        _, n_O = model.grid.distance_and_normal(p_O)
        p_O = p_O + noise * generator.normal(size=len(p_O))[:, None] * n_O
        self.grasp = np.repeat(np.arange(GRASPS), CONTACTS)
        X = self.X_PO[self.grasp]
        self.p = np.array([transform_points(pose, q[None])[0] for pose, q in zip(X, p_O, strict=True)])
        self.n = np.einsum("nij,nj->ni", X[:, :, :3], n_O)
        self.is_first = np.arange(len(self.p)) % CONTACTS == 0
        self.p[self.is_first] += shift
        self.problem = SharedProblem(self.touch, [model.grid] * GRASPS, np.zeros((0, 3)), np.zeros(0))

    def touch(self, unit: np.ndarray) -> GraspContacts:
        p, J = self.p.copy(), np.zeros((len(self.p), 6, 3))
        p[self.is_first] -= SIGMA * unit
        J[self.is_first, :3] = -SIGMA * np.eye(3)
        return GraspContacts(self.grasp, p, self.n, J, np.ones(len(p), dtype=np.bool_))

    def noise(self, position: float, normal: float) -> ContactSigmas:
        return ContactSigmas(np.full(len(self.p), position), np.full(len(self.p), normal))


SHIFT = np.array([0.003, -0.002, 0.004])
