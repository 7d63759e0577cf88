"""The soft rubber layer on a fingertip.

Source: [L15] H. Liu et al., Finger contact sensing and the application in dexterous hand manipulation, 2015, in the
linear form.
"""

import dataclasses

from tactopose_drake.core.validation import positive_number
from tactopose_drake.errors import InvalidInputError

_SOFTEST = 50.0  # N/m: a newton would press in 20 mm of skin; smaller values must be in N/mm


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class SoftLayer:
    """A layer that a contact presses in along the normal by d = normal force / stiffness.

    The fingertip's surface is the outside of the undeformed layer; at a contact the surface that carries the force lies
    d farther in, with the same normal, so p = q - d n for a point q of the undeformed surface. Shear is neglected. The
    linear law holds for small deformations; a contact is invalid if its deformation reaches the layer's thickness, or
    the surface's radius of curvature, where the offset surface folds over.

    Attributes:
        thickness: m, > 0.
        stiffness: normal force over deformation, N/m, >= 50: the slope of the curve measured by pressing the fingertip
            on a flat plate. A patch of area A pressed evenly gives E A / thickness with Young's modulus E.

    Raises:
        InvalidInputError: a thickness or stiffness that is not positive, or a stiffness that is not from 50 to 1e12.
    """

    thickness: float
    stiffness: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "thickness", positive_number("thickness", self.thickness))
        object.__setattr__(
            self, "stiffness", positive_number("stiffness", self.stiffness, least=_SOFTEST, most=1e12, unit="N/m")
        )

    def check_fits(self, half_width: float) -> None:
        """Checks that the layer leaves a core inside a fingertip with this least half-width, m.

        Raises:
            InvalidInputError: if it does not.
        """
        if self.thickness >= half_width:
            raise InvalidInputError(
                f"thickness must be less than the surface's half-width, {half_width:g} m, not {self.thickness:g} m."
            )
