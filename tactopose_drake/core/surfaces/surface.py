"""The base class of fingertip surfaces: the implicit function S(p), its derivatives, and its pose in the sensor frame.

Source: [B16] J. Bimbo, thesis, 2016, section 2.2.1.
"""

import abc
import dataclasses
from typing import ClassVar, Final

import numpy as np
from numpy.typing import ArrayLike

from tactopose_drake.core import poses
from tactopose_drake.core.geometry_checks import pose_near
from tactopose_drake.core.plain_values import ReadOnlyCopies, numbers
from tactopose_drake.core.surfaces import surface_kernels
from tactopose_drake.core.validation import FloatArray, finite_array, positive_number, positive_numbers
from tactopose_drake.errors import InvalidInputError

LEAST_LENGTH: Final = 1e-6
MOST_LENGTH: Final = 1.0
"""Bounds on the lengths of a fingertip, m: smaller ones lose precision, and larger ones are in millimetres."""


@dataclasses.dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Surface(ReadOnlyCopies, abc.ABC):
    """A convex surface S(p) = 0 of a fingertip, in a frame F that X_SF places in the sensor frame S.

    S is dimensionless, negative inside and positive outside: the square of the surface's gauge, minus one (on a sphere
    |p|^2 / radius^2 - 1). All points and normals are given and returned in S, as rows.

    Attributes:
        X_SF: pose of the surface's frame, shape (3, 4) = [R | p], p in m. Accepts a (3, 4) or (4, 4) array or an object
            with `GetAsMatrix34`, such as pydrake's RigidTransform; the identity by default.
        shape: the surface's numbers as the compiled kernels take them.
    """

    X_SF: FloatArray = dataclasses.field(default_factory=lambda: np.eye(3, 4))
    shape: FloatArray = dataclasses.field(init=False, repr=False)

    kind: ClassVar[int]

    def __post_init__(self) -> None:
        X_SF = pose_near("X_SF", self.X_SF, MOST_LENGTH)
        X_SF.setflags(write=False)
        object.__setattr__(self, "X_SF", X_SF)
        shape = np.array(self._shape(), dtype=np.float64)
        shape.setflags(write=False)
        object.__setattr__(self, "shape", shape)

    def __repr__(self) -> str:
        own = (field.name for field in dataclasses.fields(self) if field.name not in ("X_SF", "shape"))
        told = ", ".join(f"{name} {getattr(self, name)}" for name in own)
        return f"<{type(self).__name__}: {told}, p_SF {numbers(1e3 * self.X_SF[:, 3], 1)} mm>"

    @property
    def extent(self) -> float:
        """Largest distance from F's origin that the surface's bounding box reaches, m."""
        return float(self.shape[7])

    @property
    def half_width(self) -> float:
        """Smallest distance from the centre or axis to the surface along F's axes, m."""
        return float(self.shape[:3].min() if self.kind == surface_kernels.SMOOTH else self.shape[0])

    def value(self, p_SQ: ArrayLike) -> FloatArray:
        """S at points p_SQ (n, 3), m; shape (n,)."""
        return self._evaluate(p_SQ)[0]

    def gradient(self, p_SQ: ArrayLike) -> FloatArray:
        """Gradient of S in S's axes at points p_SQ (n, 3), m; shape (n, 3), 1/m."""
        return self._evaluate(p_SQ)[1] @ self.X_SF[:, :3].T

    def hessian(self, p_SQ: ArrayLike) -> FloatArray:
        """Second derivatives of S in S's axes at points p_SQ (n, 3), m; shape (n, 3, 3), 1/m^2."""
        R_SF = self.X_SF[:, :3]
        hessian: FloatArray = R_SF @ self._evaluate(p_SQ)[2] @ R_SF.T
        return hessian

    def normal(self, p_SQ: ArrayLike) -> FloatArray:
        """Outward unit normals in S at points p_SQ (n, 3) of the surface, m; shape (n, 3). [B16] eq. 2.4."""
        gradient = self.gradient(p_SQ)
        n_S: FloatArray = gradient / np.linalg.norm(gradient, axis=1, keepdims=True)
        return n_S

    def sample(self, generator: np.random.Generator, count: int) -> FloatArray:
        """Random points p_SQ (count, 3), m, over the whole part that can be touched, not uniform by area."""
        return poses.transform_points(self.X_SF, self._sample(generator, count))

    @abc.abstractmethod
    def _shape(self) -> tuple[float, ...]:
        """Checks the fields and returns the eight numbers that `surface_kernels` names."""

    @abc.abstractmethod
    def _sample(self, generator: np.random.Generator, count: int) -> FloatArray:
        """Random points in F, shape (count, 3), m."""

    def _evaluate(self, p_SQ: ArrayLike) -> tuple[FloatArray, FloatArray, FloatArray]:
        points = finite_array("p_SQ", p_SQ, (None, 3))
        p_FQ = poses.transform_points(poses.inverse(self.X_SF), points)
        value, gradient, hessian = np.empty(len(points)), np.empty((len(points), 3)), np.empty((len(points), 3, 3))
        surface_kernels.evaluate(self.kind, self.shape, p_FQ, value, gradient, hessian)
        return value, gradient, hessian


def one_length(name: str, value: float, *, allow_zero: bool = False) -> float:
    """Checks a length above zero (or zero, if allowed), m.

    Raises:
        InvalidInputError: otherwise.
    """
    _check_metres(name, finite_array(name, value, ()))
    return positive_number(name, value, allow_zero=allow_zero, least=LEAST_LENGTH, most=MOST_LENGTH)


def three_lengths(name: str, value: ArrayLike) -> tuple[float, float, float]:
    """Checks three lengths above zero, m.

    Raises:
        InvalidInputError: otherwise.
    """
    _check_metres(name, finite_array(name, value, (3,)))
    a, b, c = positive_numbers(name, value, (3,), least=LEAST_LENGTH, most=MOST_LENGTH).tolist()
    return a, b, c


def _check_metres(name: str, lengths: FloatArray) -> None:
    if lengths.max() > MOST_LENGTH:
        raise InvalidInputError(
            f"{name} must be at most {MOST_LENGTH:g} m, not {lengths.tolist()} m. Multiply by 0.001 what is in "
            "millimetres."
        )


def random_directions(generator: np.random.Generator, count: int) -> FloatArray:
    """Unit vectors, uniform over the sphere, shape (count, 3)."""
    vectors = generator.normal(size=(count, 3))
    directions: FloatArray = vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
    return directions
