"""Balance of forces as evidence: the object is at rest under the contact forces and gravity."""

import dataclasses

from tactopose_drake.core.plain_values import PlainValue
from tactopose_drake.core.validation import FloatArray, limited, positive_number


@dataclasses.dataclass(frozen=True, eq=False)
class ForceBalance(PlainValue):
    """The object is at rest, and nothing but gravity and the measured contacts acts on it.

    This holds for an object held by sensing fingertips alone. A palm or a table that supports it too breaks the
    balance.

    Attributes:
        gravity_P: acceleration of gravity in the palm frame, shape (3,), m/s^2, up to 1000.
        sigma_torque: standard deviation of each component of the torque that a soft fingertip transmits in addition to
            its force, N m, from 1e-12 to 1000.

    Raises:
        InvalidInputError: values that are not finite numbers, or a number out of its range.
    """

    gravity_P: FloatArray
    sigma_torque: float = 0.001

    def __post_init__(self) -> None:
        gravity_P = limited("gravity_P", self.gravity_P, (3,), most=1e3)
        gravity_P.setflags(write=False)
        object.__setattr__(self, "gravity_P", gravity_P)
        object.__setattr__(
            self, "sigma_torque", positive_number("sigma_torque", self.sigma_torque, least=1e-12, most=1e3)
        )
