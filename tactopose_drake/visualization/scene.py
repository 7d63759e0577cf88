"""What a picture of an estimate shows, all in the palm frame."""

import dataclasses

import numpy as np
from pydrake.math import RigidTransform

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.sensing.patches import Patch
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import FloatArray
from tactopose_drake.visualization.body_meshes import Triangles

Colour = tuple[float, float, float]

PRIOR_COLOUR: Colour = (0.93, 0.55, 0.20)
ESTIMATE_COLOUR: Colour = (0.20, 0.55, 0.85)
TRUTH_COLOUR: Colour = (0.06, 0.45, 0.16)
CONTACT_COLOUR: Colour = (0.85, 0.10, 0.20)
FORCE_COLOUR: Colour = (0.85, 0.10, 0.20)
NORMAL_COLOUR: Colour = (0.55, 0.20, 0.70)
PRESSURE_COLOUR: Colour = (0.98, 0.80, 0.08)
# The longest force arrow, m; the others are in proportion.
LONGEST_ARROW = 0.05


@dataclasses.dataclass(frozen=True, eq=False, kw_only=True)
class Scene:
    """An object, a touch, and where each source puts the object.

    Attributes:
        model: the object.
        contacts: the touch, in the palm frame P.
        patches: of it, what tactile pads feel; their pressed cells are drawn.
        prior: pose X_PO that was known before the touch, if any.
        estimate: pose X_PO that the touch gives, if any.
        truth: true pose X_PO, if it is known.
        hand: the hand's surface in P, if it is known.
        up_P: direction in P that is up in pictures, shape (3,).
    """

    model: ObjectModel
    contacts: Contacts
    patches: tuple[Patch, ...] = ()
    prior: RigidTransform | None = None
    estimate: RigidTransform | None = None
    truth: RigidTransform | None = None
    hand: Triangles | None = None
    up_P: FloatArray = dataclasses.field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))


def arrow_lengths(contacts: Contacts) -> FloatArray:
    """Lengths of the force arrows, shape (k,), m: in proportion to the forces; zeros without."""
    if contacts.f_PC is None or not len(contacts):
        return np.zeros(len(contacts))
    forces = np.linalg.norm(contacts.f_PC, axis=1)
    lengths: FloatArray = forces * (LONGEST_ARROW / max(float(forces.max()), 1e-12))
    return lengths
