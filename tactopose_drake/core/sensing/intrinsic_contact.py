"""Intrinsic contact sensing: where and how a fingertip is touched, from one wrench.

A single contact at p, with force f and a local torque about the normal n, loads the sensor with

    m = p x f + torque n,   S(p) = 0,   n = grad S / |grad S|        [B16] eqs. 2.2 to 2.4

four equations for p and the torque. Split along n and across it, they are two equations on the surface: the part of
m - p x f in the tangent plane is zero. Their Jacobian has the determinant (f.n)^2 + torque^2 K, with K >= 0 the
surface's Gaussian curvature, so every solution counts +1 in the index of that field. On a closed convex surface the
indices add up to 2: there is one solution that pushes (f.n < 0) and one that pulls, and only the first is a contact.
So the solution is unique, and a damped Newton iteration on the surface finds it.

Six measured numbers determine the six unknowns (two of p, three of f, the torque), so the exact solution is also the
weighted least-squares and maximum-likelihood estimate, whatever the covariances of m and f: weights change nothing.

Sphere, ellipsoid ([BSB93]), cylinder and capsule are solved in closed form, superquadrics and soft layers by
iteration.

Sources: [B16] J. Bimbo, thesis, 2016, section 2.2.1; [BSB93] A. Bicchi, J. K. Salisbury, D. L. Brock, Contact sensing
from force measurements, 1993.
"""

import dataclasses
import math
from typing import Final, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactopose_drake.core.compilation import read_only
from tactopose_drake.core.sensing import contact_kernels
from tactopose_drake.core.sensing.soft_layer import SoftLayer
from tactopose_drake.core.surfaces.surface import Surface
from tactopose_drake.core.validation import (
    MOST_MEASURED_FORCE,
    FloatArray,
    finite_array,
    instance_of,
    known_name,
    number_array,
    positive_number,
)

# Below this force (N) a Nano17's noise moves the point on a 9 mm fingertip by 0.9 mm rms: not informative.
MIN_FORCE: Final = 0.05

Method = Literal["auto", "newton"]

_REASONS: Final[dict[int, str]] = {
    contact_kernels.VALID: "",
    contact_kernels.NOT_FINITE: "the wrench is not finite",
    contact_kernels.TOO_WEAK: "the force is below min_force",
    contact_kernels.MISSES: "no single contact explains the wrench: the force passes the surface by",
    contact_kernels.TENSION: "the force pulls on the surface; a contact can only push",
    contact_kernels.OUTSIDE: "the contact would lie outside of the part of the surface that can be touched",
    contact_kernels.FRICTION: "the friction force exceeds what friction_coefficient allows",
    contact_kernels.TORQUE: "the local torque exceeds what friction on a patch of the fingertip's size can give",
    contact_kernels.LAYER: "the soft layer is pressed in by more than its thickness or the surface's radius",
    contact_kernels.TOO_STRONG: f"the force is beyond {MOST_MEASURED_FORCE:g} N: it must be in millinewtons",
}
_REASON_TABLE: Final = np.array([_REASONS[code] for code in range(len(_REASONS))], dtype=object)


@dataclasses.dataclass(frozen=True, eq=False, slots=True)
class ContactSolution:
    """One contact of a fingertip, in the sensor frame S. All numbers are NaN if it is not valid.

    Attributes:
        p_SC: contact point, shape (3,), m.
        n_S: outward unit normal of the fingertip's surface there, shape (3,); the normal force points against it.
        normal_force: shape (3,), N. [B16] eq. 2.5
        friction_force: shape (3,), N. [B16] eq. 2.6
        local_torque: torque about the normal, shape (3,), N m.
        residual: magnitude of the moment that the contact does not explain, N m: rounding error.
        deformation: how far the soft layer is pressed in, m.
        iterations: of Newton's method; 0 in closed form.
        valid: whether a single contact explains the wrench.
        reason: why it is not valid; empty if it is.
    """

    p_SC: FloatArray
    n_S: FloatArray
    normal_force: FloatArray
    friction_force: FloatArray
    local_torque: FloatArray
    residual: float
    deformation: float
    iterations: int
    valid: bool
    reason: str

    @property
    def is_untouched(self) -> bool:
        """Whether the sensor says that nothing touches the fingertip."""
        return self.reason.startswith(_REASONS[contact_kernels.TOO_WEAK])


@dataclasses.dataclass(frozen=True, eq=False, slots=True)
class ContactSolutions:
    """Contacts of a batch of wrenches on one fingertip: like `ContactSolution`, with a leading axis (B,).

    Attributes:
        p_SC, n_S, normal_force, friction_force, local_torque: shape (B, 3).
        residual, deformation, iterations, valid: shape (B,).
        reason: shape (B,), strings.
    """

    p_SC: FloatArray
    n_S: FloatArray
    normal_force: FloatArray
    friction_force: FloatArray
    local_torque: FloatArray
    residual: FloatArray
    deformation: FloatArray
    iterations: NDArray[np.int64]
    valid: NDArray[np.bool_]
    reason: NDArray[np.object_]

    def __len__(self) -> int:
        return len(self.valid)

    def __getitem__(self, index: int) -> ContactSolution:
        return ContactSolution(
            self.p_SC[index],
            self.n_S[index],
            self.normal_force[index],
            self.friction_force[index],
            self.local_torque[index],
            float(self.residual[index]),
            float(self.deformation[index]),
            int(self.iterations[index]),
            bool(self.valid[index]),
            str(self.reason[index]),
        )


def solve_contact(
    F_S: ArrayLike,
    surface: Surface,
    *,
    layer: SoftLayer | None = None,
    min_force: float = MIN_FORCE,
    friction_coefficient: float | None = None,
    method: Method = "auto",
) -> ContactSolution:
    """Finds the contact that explains one wrench. [B16] eqs. 2.2 to 2.6.

    Args:
        F_S: wrench [m, f] that the environment exerts on the fingertip, about S's origin, in S, shape (6,), N m and N.
        surface: the fingertip's surface; `X_SF` places it in S.
        layer: soft layer on the fingertip; None for a rigid one.
        min_force: force below which no contact is reported, N, >= 0.
        friction_coefficient: upper bound of the coefficient, > 0; leave a margin for the sensor's noise. It bounds the
            friction force, and the local torque by that of a contact patch as large as the fingertip. Without it, the
            bounds are those of a coefficient of 10.
        method: "auto" uses the closed form if there is one, "newton" always iterates.

    A pull on a closed surface, or on a cylinder's side, is the same wrench as a push on its far side, and is returned
    as that.

    Raises:
        InvalidInputError: a wrench of another shape or not finite, an option out of its range, or a layer as thick as
            the fingertip.
        UnknownNameError: another method.
    """
    wrench = finite_array("F_S", F_S, (6,))
    return FingertipSolver(surface, layer, min_force, friction_coefficient, method).solve(wrench)


def solve_contacts(
    F_S: ArrayLike,
    surface: Surface,
    *,
    layer: SoftLayer | None = None,
    min_force: float = MIN_FORCE,
    friction_coefficient: float | None = None,
    method: Method = "auto",
) -> ContactSolutions:
    """Finds the contacts that explain wrenches on one fingertip, each independently; see `solve_contact`.

    A wrench with a NaN or infinite number is not an error here but a row that is not valid, as is one beyond 1000 N.

    Args:
        F_S: wrenches on the fingertip about S's origin, shape (B, 6), N m and N.
        surface: the fingertip's surface.
        layer: its soft layer; None for a rigid fingertip.
        min_force: force below which there is no contact, N.
        friction_coefficient: upper bound of the coefficient; a wrench that needs more is not valid. Without it, the
            bounds are those of a coefficient of 10, as in `solve_contact`.
        method: as in `solve_contact`.

    Raises:
        InvalidInputError: wrenches of another shape, an option out of its range, or a layer as thick as the fingertip.
        UnknownNameError: another method.
    """
    return FingertipSolver(surface, layer, min_force, friction_coefficient, method).solve_all(F_S)


# N; with a tolerance for rounding when the force is rotated into the palm frame.
_STRONGEST = (1.0 - 1e-9) * MOST_MEASURED_FORCE


@dataclasses.dataclass(frozen=True, eq=False)
class FingertipSolver:
    """A solver for the contacts of one fingertip, for use in a loop: its options are checked once.

    Attributes:
        surface, layer, min_force, friction_coefficient, method: as in `solve_contacts`.

    Raises:
        InvalidInputError: an option out of its range, or a layer as thick as the fingertip.
        UnknownNameError: another method.
    """

    surface: Surface
    layer: SoftLayer | None = None
    min_force: float = MIN_FORCE
    friction_coefficient: float | None = None
    method: Method = "auto"
    _conditions: contact_kernels.Conditions = dataclasses.field(init=False, repr=False)

    def __post_init__(self) -> None:
        known_name("method", self.method, get_args(Method))
        instance_of("surface", self.surface, Surface)
        friction, compliance, thickness = math.inf, 0.0, 0.0
        least = positive_number("min_force", self.min_force, allow_zero=True)
        if self.friction_coefficient is not None:
            friction = positive_number("friction_coefficient", self.friction_coefficient)
        if self.layer is not None:
            instance_of("layer", self.layer, SoftLayer)
            self.layer.check_fits(self.surface.half_width)
            compliance, thickness = 1.0 / self.layer.stiffness, self.layer.thickness
        limits = read_only(np.array([least, friction, compliance, thickness, _STRONGEST]))
        object.__setattr__(self, "_conditions", contact_kernels.Conditions(limits, self.method == "newton"))

    def solve(self, F_S: ArrayLike) -> ContactSolution:
        """The contact of one wrench, shape (6,), N m and N; not valid if a number is not finite.

        Raises:
            InvalidInputError: a wrench of another shape.
        """
        out, codes = self._run(number_array("F_S", F_S, (6,))[None])
        row, code = out[0], int(codes[0])
        return ContactSolution(
            row[0:3],
            row[3:6],
            row[6:9],
            row[9:12],
            row[12:15],
            float(row[15]),
            float(row[16]),
            0 if code else int(row[17]),
            code == contact_kernels.VALID,
            self._too_weak if code == contact_kernels.TOO_WEAK else _REASONS[code],
        )

    def solve_all(self, F_S: ArrayLike) -> ContactSolutions:
        """The contacts of wrenches (B, 6), N m and N.

        Raises:
            InvalidInputError: wrenches of another shape.
        """
        out, codes = self._run(number_array("F_S", F_S, (None, 6)))
        valid, reasons = codes == contact_kernels.VALID, _REASON_TABLE[codes]
        reasons[codes == contact_kernels.TOO_WEAK] = self._too_weak
        return ContactSolutions(
            out[:, 0:3],
            out[:, 3:6],
            out[:, 6:9],
            out[:, 9:12],
            out[:, 12:15],
            out[:, 15],
            out[:, 16],
            np.where(valid, out[:, 17], 0.0).astype(np.int64),
            valid,
            reasons,
        )

    @property
    def _too_weak(self) -> str:
        return f"{_REASONS[contact_kernels.TOO_WEAK]} ({self.min_force:g} N)"

    def _run(self, wrenches: FloatArray) -> tuple[FloatArray, NDArray[np.int64]]:
        """Rows (B, RESULT_SIZE), read-only, and codes (B,)."""
        surface, count = self.surface, len(wrenches)
        out, codes = np.empty((count, contact_kernels.RESULT_SIZE)), np.empty(count, dtype=np.int64)
        contact_kernels.solve(surface.kind, surface.shape, surface.X_SF, wrenches, self._conditions, out, codes)
        out.setflags(write=False)
        return out, codes
