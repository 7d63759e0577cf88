"""Contacts of the hand with the object at one instant, in the palm frame."""

import dataclasses
import math
from collections.abc import Collection, Iterable, Iterator, Sequence, Sized
from typing import Any, Never, Protocol, Self, SupportsIndex

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactopose_drake.core.evidence.contact_variance_kernels import fill_variances
from tactopose_drake.core.geometry_checks import in_steps, points_near, unit_vectors
from tactopose_drake.core.plain_values import PlainValue, copied
from tactopose_drake.core.validation import MOST_FORCE, FloatArray, kind_name, limited, positive_numbers, remark, shown
from tactopose_drake.errors import InvalidInputError

SIGMA_LIMITS = {"sigma_position": (1e-7, 1e6, "m"), "sigma_normal": (1e-5, 1e6, "rad"), "sigma_force": (1e-6, 1e6, "N")}
"""Beyond these, the information of a contact and of the rest exceed the precision of a double."""
_COLUMNS = (*(f"{kind}_{axis}" for kind in "pnf" for axis in "xyz"), *SIGMA_LIMITS)  # of a table of contacts
MOST_SIGMA_POSITION = 0.1
"""The largest standard deviation of positions that is accepted, m: larger ones are useless, and probably in mm."""
_MOST_DEGREES = 360.0  # Larger standard deviations of normals, rad, are meant to say nothing.
# An estimate from this many takes a second; a scan's points are best thinned to fewer.
_MOST_CONTACTS = 5000
_MOST_COVARIANCE = 1e12
_ROUNDING = 1e-9  # tolerance of symmetry, relative to a matrix's largest entry


class DataFrame(Protocol):
    """A table with named columns, such as one of pandas or Polars."""

    @property
    def columns(self) -> Iterable[Any]:
        """The columns' names."""

    def __getitem__(self, name: str, /) -> Any:
        """A column."""


@dataclasses.dataclass(frozen=True, eq=False)
class Contacts(PlainValue):
    """Measured contacts, in the palm frame P. Their errors count as independent, even of contacts at one place.

    Attributes:
        p_PC: contact points, shape (k, 3), m; up to 5000, with coordinates up to 10 m, as larger ones are probably in
            millimetres.
        n_PC: outward unit normals of the object's surface at the contacts, shape (k, 3), or None. They point out of
            the object into the finger, which is the direction of the normal force on the fingertip.
        f_PC: forces on the fingertips, shape (k, 3), N, up to 1e6; or None.
        sigma_position: standard deviation of each coordinate of p_PC, a number or shape (k,), m, from 1e-7 to 0.1,
            as larger ones are probably in millimetres.
        sigma_normal: standard deviation of a small rotation of n_PC about each axis, a number or shape (k,),
            rad, from 1e-5 to 1e6. From pi to 360 is logged as a remark, since it is probably in degrees.
        sigma_force: standard deviation of each component of f_PC, a number or shape (k,), N, from 1e-6 to 1e6.
        covariance: of each contact's point and a small rotation of its normal, shape (k, 6, 6), m and rad; None to use
            the sigmas. It replaces them: `sigma_position` is then the point's standard deviation along the normal, as
            nothing is measured across it, or the mean one if there is no normal; `sigma_normal` is the root mean square
            of the rotations about the two axes across the normal. The correlation of point and normal is not used. The
            point's uncertainty along the surface widens both by how uneven the object's surface is over that length;
            of `sigma_position`, only what exceeds a millimetre does, so equal values may give slightly other answers.

    Raises:
        InvalidInputError: values that are not finite numbers, too many contacts, a shape that does not fit, a normal
            whose length differs from 1 by more than 1e-3, a number out of its range, or a covariance that is not
            symmetric and positive semidefinite, or whose sigma for a point or a normal is out of range.
    """

    p_PC: FloatArray
    n_PC: FloatArray | None = None
    f_PC: FloatArray | None = None
    sigma_position: FloatArray | float = 0.0009
    sigma_normal: FloatArray | float = math.radians(5.0)
    sigma_force: FloatArray | float = 0.05
    covariance: FloatArray | None = None

    def __post_init__(self) -> None:
        p_PC = points_near("p_PC", self.p_PC, (None, 3))
        shape, count = (len(p_PC), 3), len(p_PC)
        if count > _MOST_CONTACTS:
            raise InvalidInputError(f"p_PC must have at most {_MOST_CONTACTS} contacts, not {count}.")
        n_PC = None if self.n_PC is None else unit_vectors("n_PC", self.n_PC, shape)
        covariance = None if self.covariance is None else _covariances(self.covariance, count)
        sigmas, limits = {name: getattr(self, name) for name in SIGMA_LIMITS}, dict(SIGMA_LIMITS)
        told = {name: name for name in SIGMA_LIMITS}  # Names used in messages.
        if covariance is None:
            limits["sigma_position"] = (1e-7, MOST_SIGMA_POSITION, "m")
        else:
            sigmas["sigma_position"], sigmas["sigma_normal"] = _sigmas_of(covariance, n_PC)
            told |= {name: f"covariance: its {name}" for name in ("sigma_position", "sigma_normal")}
            _check_definite(covariance)
        values: dict[str, FloatArray | None] = {
            "p_PC": p_PC,
            "n_PC": n_PC,
            "f_PC": None if self.f_PC is None else limited("f_PC", self.f_PC, shape, most=MOST_FORCE),
            **{name: _sigmas(told[name], sigmas[name], count, *limits[name]) for name in SIGMA_LIMITS},
            "covariance": covariance,
        }
        turned = values["sigma_normal"] if n_PC is not None and covariance is None else None
        if turned is not None and math.pi < (widest := turned.max(initial=0.0)) <= _MOST_DEGREES:
            cure = "Multiply by pi / 180 what is in degrees, or leave out n_PC"
            remark(f"Contacts: sigma_normal is {widest:g} rad, with which normals say nothing. {cure}.")
        for name, value in values.items():
            if value is not None:
                value.setflags(write=False)
            object.__setattr__(self, name, value)

    def __len__(self) -> int:
        return len(self.p_PC)

    def __getitem__(self, index: SupportsIndex | slice | Sequence[int] | NDArray[np.integer | np.bool_]) -> Self:
        """One contact by its index, or several by a slice, indices or a mask; the result is `Contacts` too.

        Raises:
            IndexError: an index out of range.
            InvalidInputError: an index of another type.
        """
        try:
            rows = np.atleast_1d(np.arange(len(self))[index])
        except (IndexError, TypeError, ValueError) as error:
            if "out of bounds" in str(error):
                raise
            rows = None
        if rows is None or rows.ndim > 1:
            raise InvalidInputError(
                f"index must be a number, a slice, numbers or a mask of length {len(self)}, not {shown(index)}."
            )
        arrays = {field.name: getattr(self, field.name) for field in dataclasses.fields(self)}
        return self.with_arrays(**{name: None if value is None else value[rows] for name, value in arrays.items()})

    def __iter__(self) -> Iterator[Self]:
        return (self[row] for row in range(len(self)))

    def __array__(self, *_: object, **__: object) -> Never:
        # numpy would take them for an endlessly nested sequence.
        raise TypeError("Contacts are not an array; their points are p_PC")

    def joined(self, others: Self) -> Self:
        """Concatenates these contacts and others, with the arrays that both have: normals, forces, covariances."""
        arrays: dict[str, FloatArray | None] = {}
        for field in dataclasses.fields(self):
            mine, theirs = getattr(self, field.name), getattr(others, field.name)
            arrays[field.name] = None if mine is None or theirs is None else np.concatenate([mine, theirs])
        return self.with_arrays(**arrays)

    def rounded(self) -> Self:
        """The contacts with points rounded to a nanometre and normals to a nanoradian."""
        return self.with_arrays(p_PC=in_steps(self.p_PC), n_PC=None if self.n_PC is None else in_steps(self.n_PC))

    def with_arrays(self, **arrays: FloatArray | None) -> Self:
        """The contacts with some arrays replaced, by name, without checking them again."""
        for value in arrays.values():
            if value is not None:
                value.setflags(write=False)
        return copied(self, **arrays)

    def with_covariance(self, covariance: FloatArray) -> Self:
        """The contacts with other covariances (k, 6, 6), which are not checked again."""
        position, normal = _sigmas_of(covariance, self.n_PC)
        return self.with_arrays(covariance=covariance, sigma_position=position, sigma_normal=normal)

    @property
    def normals_or_zeros(self) -> FloatArray:
        """The normals, or zeros in their place if none are measured, shape (k, 3)."""
        return np.zeros_like(self.p_PC) if self.n_PC is None else self.n_PC

    @property
    def variances(self) -> FloatArray:
        """Of each point along its normal, m^2, and of the rotation of its normal, rad^2, shape (k, 2)."""
        sigmas = np.empty((len(self), 2))
        sigmas[:, 0], sigmas[:, 1] = self.sigma_position, self.sigma_normal
        return sigmas * sigmas

    def with_variances(self, variances: FloatArray) -> Self:
        """The contacts with other `variances` (k, 2) in place of sigmas and covariances; they are not checked again."""
        position, normal = np.ascontiguousarray(np.sqrt(variances).T)
        return self.with_arrays(covariance=None, sigma_position=position, sigma_normal=normal)

    def __repr__(self) -> str:
        known = [
            "points",
            *(["normals"] if self.n_PC is not None else []),
            *(["forces"] if self.f_PC is not None else []),
        ]
        sigmas = "".join(
            f", {name} {_span(scale * np.asarray(getattr(self, name)))} {unit}"
            for name, scale, unit, is_known in (
                ("sigma_position", 1e3, "mm", True),
                ("sigma_normal", math.degrees(1.0), "deg", self.n_PC is not None),
                ("sigma_force", 1.0, "N", self.f_PC is not None),
            )
            if is_known and len(self)
        )
        return f"<Contacts: {len(self)} {', '.join(known)}{sigmas}>"

    @classmethod
    def from_dataframe(cls, frame: DataFrame, **sigmas: Any) -> Self:
        """Contacts of one touch from a table with a row for each, a DataFrame of pandas or Polars.

        Args:
            frame: has the columns `p_x`, `p_y`, `p_z` of the points, in P, m; optionally `n_x`, `n_y`, `n_z` of the
                normals, `f_x`, `f_y`, `f_z` of the forces, N, and `sigma_position`, `sigma_normal`, `sigma_force` in m,
                rad and N. Other columns are ignored, and NaN is not allowed.
            sigmas: the sigmas and `covariance`, unless the table has such columns.

        Raises:
            InvalidInputError: if a column of three is missing, columns differ in length, a sigma is given twice, or a
                value is not allowed.
        """
        if not isinstance(frame, Sized) or not hasattr(frame, "columns"):  # A lazy frame of Polars has no length.
            raise InvalidInputError(
                f"frame must be a table with named columns, such as a DataFrame, not {kind_name(type(frame))}."
            )
        every = [str(name) for name in frame.columns]
        names = {*every}
        if twice := [name for name in _COLUMNS if every.count(name) > 1]:
            raise InvalidInputError(
                f"frame must have the column {twice[0]!r} at most once, not {every.count(twice[0])} times."
            )
        vectors: dict[str, Any] = {f"{kind}_PC": _vectors(frame, names, kind) for kind in "pnf"}
        if vectors["p_PC"] is None:
            raise InvalidInputError(
                "frame must have the columns p_x, p_y and p_z of the points, m, but lacks all three."
            )
        for name in SIGMA_LIMITS.keys() & names:
            if name in sigmas:
                raise InvalidInputError(f"{name} must be an argument or a column of the table, not both.")
            sigmas[name] = np.asarray(frame[name])
        return cls(**vectors, **sigmas)

    @classmethod
    def empty(cls) -> Self:
        """No contacts."""
        return cls(np.zeros((0, 3)))


def _vectors(frame: DataFrame, names: Collection[str], kind: str) -> list[list[float]] | FloatArray | None:
    """Three columns of a table as rows; None if it has none of the three."""
    wanted = [f"{kind}_{axis}" for axis in "xyz"]
    missing = [name for name in wanted if name not in names]
    if len(missing) == len(wanted):
        return None
    if missing:
        raise InvalidInputError(
            f"frame must have all of the columns {', '.join(wanted)}, or none, but lacks {missing[0]!r}."
        )
    columns = [np.atleast_1d(frame[name]).tolist() for name in wanted]
    lengths = [len(column) for column in columns]
    if len(set(lengths)) > 1:
        raise InvalidInputError(
            f"frame must have as many rows in each of the columns {', '.join(wanted)}, not {lengths}."
        )
    return [list(row) for row in zip(*columns, strict=True)] or np.zeros((0, 3))


def _span(values: FloatArray) -> str:
    """Formats a number, or the least and the largest of several."""
    least, most = f"{values.min():.3g}", f"{values.max():.3g}"
    return least if least == most else f"{least} to {most}"


def _covariances(value: ArrayLike, count: int) -> FloatArray:
    """Checks the shape and symmetry of matrices (k, 6, 6)."""
    covariance = limited("covariance", value, (count, 6, 6), most=_MOST_COVARIANCE)
    off = np.abs(covariance - np.swapaxes(covariance, 1, 2)).max(initial=0.0)
    if off > _ROUNDING * np.abs(covariance).max(initial=0.0):
        raise InvalidInputError(f"covariance must be symmetric, not asymmetric by {off:.3g}.")
    return covariance


def _check_definite(covariance: FloatArray) -> None:
    """Raises InvalidInputError if a matrix of (k, 6, 6) is not a covariance: if its least eigenvalue is negative."""
    # Scaled by the largest standard deviations of point and rotation, so that metres and radians are comparable.
    scale = np.sqrt(np.einsum("kii->ki", covariance).reshape(-1, 2, 3).max(axis=2)).repeat(3, axis=1)
    scale[scale == 0.0] = 1.0
    least = np.linalg.eigvalsh(covariance / (scale[:, :, None] * scale[:, None, :]))[:, 0]
    if least.min(initial=0.0) < -_ROUNDING:
        raise InvalidInputError(
            f"covariance[{int(least.argmin())}] must be positive semidefinite, but some combination of errors has a "
            "variance below 0."
        )


def _sigmas_of(covariance: FloatArray, n_PC: FloatArray | None) -> tuple[FloatArray, FloatArray]:
    """Standard deviations of the distance and of the normal's rotation from covariances (k, 6, 6), shape (k,)."""
    variances = np.empty((2, len(covariance)))
    fill_variances(covariance, np.zeros((0, 3)) if n_PC is None else n_PC, variances)
    if variances.min(initial=np.inf) <= 0.0:
        which, row = np.unravel_index(variances.argmin(), variances.shape)
        raise InvalidInputError(
            f"covariance[{row}] must have a variance of the {('point', 'normal')[which]} above 0, not "
            f"{variances[which, row]:.3g}."
        )
    position, normal = np.sqrt(variances)
    return position, normal


def _sigmas(name: str, value: ArrayLike, count: int, least: float, most: float, unit: str) -> FloatArray:
    return np.full(count, positive_numbers(name, value, (), (count,), least=least, most=most, unit=unit))
