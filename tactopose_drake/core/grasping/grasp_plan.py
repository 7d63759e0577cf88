"""A planned grasp: where the object is in the palm, and what each finger does."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from tactopose_drake.core.grasping.grasp_law import ClosingMotion
from tactopose_drake.core.validation import FloatArray


@dataclass(frozen=True, eq=False)
class FingerPlan:
    """What one finger is to do, and where it is meant to touch: point (3,), m, and object's normal (3,), in P."""

    motion: ClosingMotion
    p_PC: FloatArray
    n_PC: FloatArray


@dataclass(frozen=True, eq=False)
class GraspPlan:
    """An object's pose in the palm, and the fingers that touch it.

    Attributes:
        X_PO: shape (3, 4).
        fingers: by name; fingers that take no part are absent.
        score: larger is better.
        waiting: actuated joint positions, shape (m,), rad or m, of the fingers that take no part and would be in the
            object's way where they usually wait, by name.
    """

    X_PO: FloatArray
    fingers: Mapping[str, FingerPlan]
    score: float
    waiting: Mapping[str, FloatArray] = field(default_factory=dict)
