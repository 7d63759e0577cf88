"""How well an object explains a touch, whatever its pose: the marginal likelihood that tells objects apart.

It is the integral of the touch's likelihood over the poses that the object may have. A finger may touch any place of a
surface, each as likely as any other, so that every contact's likelihood is by the area: of two objects that can be laid
on the contacts equally well, and in as many ways, the smaller one is more probable, because the larger one offers more
places where the fingers could have been instead [M03].

Source: [M03] D. MacKay, Information Theory, Inference, and Learning Algorithms, 2003, chapter 28.
"""

import math

from tactopose_drake.core.evidence.evidence import Evidence
from tactopose_drake.core.shape.object_model import ObjectModel


def log_evidence(model: ObjectModel, evidence: Evidence, log_mass: float, images: int | None = None) -> float:
    """Logarithm of the marginal likelihood, up to a constant that is the same for every object.

    Without a prior all rotations, and all translations in the hand's surroundings, are equally likely.

    Args:
        model: the object.
        evidence: the touch.
        log_mass: `Modes.log_mass`, of the hypotheses.
        images: of so many, which the object's finite symmetries make of a mode, it holds one: of those that the touch
            does not tell apart; of all, if it is not given.
    """
    # A prior tells the images of a mode apart.
    alike = 1 if evidence.prior is not None else len(model.symmetry_poses) if images is None else images
    return log_mass + math.log(alike) - len(evidence.touch) * math.log(model.area)
