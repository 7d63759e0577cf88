"""Problems with known answers for every search."""

import numpy as np

from tactopose_drake.core.evidence.gaussian_prior import GaussianPrior
from tactopose_drake.core.objectives.objective import SumObjective
from tactopose_drake.core.objectives.pose_prior import PriorObjective
from tactopose_drake.core.objectives.surface_contact import SurfaceContact
from tactopose_drake.core.poses import make_poses, random_rotations, retract
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.synthetic.synthetic_touch import touch_surface


def make_touch(
    model: ObjectModel, seed: int, offset_translation: float = 0.01, offset_rotation: float = 0.1
) -> tuple[SumObjective, GaussianPrior, np.ndarray]:
    """Six exact contacts, a prior that is off by the given amounts, and the true pose (3, 4)."""
    generator = np.random.default_rng(seed)
    X_PO = make_poses(random_rotations(generator, 1), generator.normal(size=(1, 3)) * 0.05)[0]
    contacts = touch_surface(model, X_PO, 6, generator)
    w, v = (u / np.linalg.norm(u) for u in generator.normal(size=(2, 3)))
    prior = GaussianPrior(retract(X_PO, np.concatenate([offset_rotation * w, offset_translation * v])))
    return SumObjective([SurfaceContact(model.grid, contacts), PriorObjective(prior)]), prior, X_PO
