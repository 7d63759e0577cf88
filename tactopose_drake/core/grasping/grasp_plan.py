"""A planned grasp: the object's pose in the palm, and the motion of each finger."""

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
        fingers: by name; idle fingers are absent.
        score: larger is better.
        waiting: by name, actuated joint positions, shape (m,), rad or m, of idle fingers that must make way for the
            object.
    """

    X_PO: FloatArray
    fingers: Mapping[str, FingerPlan]
    score: float
    waiting: Mapping[str, FloatArray] = field(default_factory=dict)
