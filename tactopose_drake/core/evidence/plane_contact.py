"""Contact of the held object with a known plane of the world, at an unknown point of the object."""

import dataclasses

from tactopose_drake.core.geometry_checks import points_near, unit_vectors
from tactopose_drake.core.plain_values import PlainValue
from tactopose_drake.core.validation import FloatArray, positive_number


@dataclasses.dataclass(frozen=True, eq=False)
class PlaneContact(PlainValue):
    """An extrinsic contact: the object rests against a plane, such as a table or a wall, with its lowest point over it.

    The plane is known, that point is not. Several planes may be from several instants, if the object has rested in the
    hand in between.

    Attributes:
        p_PQ: a point of the plane in the palm frame, shape (3,), m; coordinates up to 10 m.
        n_P: unit normal of the plane, toward the object, shape (3,).
        sigma: standard deviation of the object's lowest point over the plane, m, from 1e-7 to 1: from errors of the
            plane, of the palm's pose, of the mesh, and of the time when the contact was noticed.

    Raises:
        InvalidInputError: values that are not finite, a normal whose length differs from 1 by more than 1e-3, or a
            number out of its range.
    """

    p_PQ: FloatArray
    n_P: FloatArray
    sigma: float = 0.001

    def __post_init__(self) -> None:
        values = {
            "p_PQ": points_near("p_PQ", [self.p_PQ], (1, 3))[0],
            "n_P": unit_vectors("n_P", [self.n_P], (1, 3))[0],
        }
        for name, value in values.items():
            value.setflags(write=False)
            object.__setattr__(self, name, value)
        object.__setattr__(self, "sigma", positive_number("sigma", self.sigma, least=1e-7, most=1.0))
