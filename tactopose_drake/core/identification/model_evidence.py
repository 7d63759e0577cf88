"""The marginal likelihood of a touch under an object, whatever its pose, by which objects are told apart.

It is the integral of the touch's likelihood over the object's poses. A finger may touch any place of a surface with
uniform density, so that every contact's likelihood is divided by the area: of two objects that fit the contacts equally
well, and in as many ways, the smaller one is more probable, because the larger one has more places where the fingers
could have been instead [M03].

Source: [M03] D. MacKay, Information Theory, Inference, and Learning Algorithms, 2003, chapter 28.
"""

import math

from tactopose_drake.core.evidence.evidence import Evidence
from tactopose_drake.core.shape.object_model import ObjectModel


def log_evidence(model: ObjectModel, evidence: Evidence, log_mass: float, images: int | None = None) -> float:
    """Log marginal likelihood, up to a constant that is the same for every object.

    Without a prior all rotations, and all translations in the hand's surroundings, are equally likely.

    Args:
        model: the object.
        evidence: the touch.
        log_mass: `Modes.log_mass`, of the hypotheses.
        images: number of symmetric images of each mode of which `log_mass` counts one: those that the touch cannot tell
            apart; by default, all that the object's finite symmetries make.
    """
    # Only a prior tells the images of a mode apart.
    alike = 1 if evidence.prior is not None else len(model.symmetry_poses) if images is None else images
    return log_mass + math.log(alike) - len(evidence.touch) * math.log(model.area)
