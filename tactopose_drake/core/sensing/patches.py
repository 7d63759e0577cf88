"""The patch that a tactile array feels, in a few numbers: its centroid, principal axes and extents.

Each pressed cell gives a point of the object's surface, as deep in the pad's soft layer as its pressure says. The patch
consists of the principal components of these points.

Source: [B16] J. Bimbo, thesis, 2016, sections 5.2.1 to 5.2.3.
"""

import dataclasses
import functools
import math
from typing import Any, Literal, TypeVar

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from tactopose_drake.core.geometry_checks import unit_vectors
from tactopose_drake.core.plain_values import ReadOnlyCopies, seal
from tactopose_drake.core.sensing.long_cells import find_stretch
from tactopose_drake.core.sensing.pad_values import (
    check_depths,
    checked_cells,
    checked_covariance,
    checked_pressures,
    checked_range,
)
from tactopose_drake.core.validation import MOST_ALPHA, FloatArray, instance_of, limited
from tactopose_drake.errors import InvalidInputError

_Array = TypeVar("_Array", bound="np.ndarray[Any, Any]")
PatchStatus = Literal["area", "narrow", "row", "point", "no_contact"]

_LEAST_AGREEMENT = 0.1  # least length of the mean of normals that have a direction in common
_LEAST_EXTENT = 1e-9  # m; cells within this distance are at one place


@dataclasses.dataclass(frozen=True, kw_only=True)
class PatchParams:
    """Thresholds on the shape of pads and patches."""

    # A pad is flat, and active cells are in a row, if their extent across is less than this share of their length.
    flat_share: float = 0.03
    # Without normals, the z axis determines a flat pad's side; the sine of its angle to the pad's plane must be at
    # least this.
    least_rise: float = 0.1
    # The third eigenvector is the surface's normal if its angle to the pad's has at least this cosine: 45 degrees.
    least_alignment: float = math.sqrt(0.5)


@dataclasses.dataclass(frozen=True, eq=False)
class Patch(ReadOnlyCopies):
    """What one pad feels at one instant, in the palm frame P (or any frame that its cells are given in).

    Unknown numbers are NaN. `status` tells how much is known:

    - "area": everything. The third eigenvector is the outward normal of the object's surface.
    - "narrow": the principal components, but the third is more than 45 degrees from the pad's normal: the depths
      differ by more than the patch is wide, so none of the components can be taken for the surface's normal.
    - "row": there are two active cells, or they lie in one line. The first eigenvector and eigenvalue are known; the
      surface's tilt about that line is not.
    - "point": one active cell, or several at one place. The centroid is known.
    - "no_contact": no active cell; each live cell tells that the object is not there.

    Attributes:
        p_PT: the pad's cells, on the undeformed pad, shape (n, 3), m.
        n_PT: outward unit normals of the pad there, out of the finger, shape (n, 3).
        pressure: shape (n,), Pa; NaN for dead cells.
        alpha: depth of the object's surface in the pad over the pressure, m/Pa.
        threshold: a cell is active above this pressure, Pa.
        saturation: the true pressure on a cell that reads this or more may be higher, Pa; infinite without a limit.
        status: what is known.
        centroid: mean of the active cells' points, shape (3,), m. [B16] eq. 5.11.
        covariance: of those points, shape (3, 3), m^2; NaN for fewer than two.
        eigenvectors: the columns are the principal axes in descending order of variance, a right-handed frame, shape
            (3, 3). The third points along the object's outward normal, into the pad; the first from the pad's first
            cell towards its last; the second completes the frame.
        eigenvalues: variances along the axes, descending, shape (3,), m^2.
        misplacement: covariance of the pad's pose error: a shift, and a small rotation about the mean of its cells, of
            all cells together, shape (6, 6), m and rad; None if unknown.
    """

    p_PT: FloatArray
    n_PT: FloatArray
    pressure: FloatArray
    alpha: float
    threshold: float
    saturation: float
    status: PatchStatus
    centroid: FloatArray
    covariance: FloatArray
    eigenvectors: FloatArray
    eigenvalues: FloatArray
    misplacement: FloatArray | None = None

    def __repr__(self) -> str:
        felt = f", most {np.nanmax(self.pressure) / 1e3:.3g} kPa" if self.is_felt else ""
        return f"<Patch: {self.status}, {int(self.active.sum())} of {len(self.pressure)} cells active{felt}>"

    @functools.cached_property
    def active(self) -> NDArray[np.bool_]:
        """Cells that feel the object, shape (n,)."""
        return _fixed(self.pressure > self.threshold)

    @property
    def is_felt(self) -> bool:
        """Whether any cell feels the object."""
        return self.status != "no_contact"

    @functools.cached_property
    def saturated(self) -> NDArray[np.bool_]:
        """Active cells whose true depth may exceed the one measured, shape (n,)."""
        return _fixed(self.pressure >= self.saturation)

    @functools.cached_property
    def dead(self) -> NDArray[np.bool_]:
        """Cells without a reading, shape (n,)."""
        return _fixed(np.isnan(self.pressure))

    @functools.cached_property
    def inward(self) -> FloatArray:
        """Unit mean of the active cells' inward normals, into the finger, shape (3,).

        NaN if nothing is felt, or the cells face all directions, like those on both sides of a finger in a slot.
        """
        mean = -self.n_PT[self.active].mean(axis=0) if self.active.any() else np.zeros(3)
        length = float(np.linalg.norm(mean))
        return _fixed(mean / length if length > _LEAST_AGREEMENT else np.full(3, np.nan))

    @functools.cached_property
    def half_pitch(self) -> float:
        """Half of the median distance from a cell to the nearest one: half of a cell's width, m; 0 for one cell.

        Cells that are longer than wide extend farther in one direction, see `stretch`.
        """
        if len(self.p_PT) < 2:
            return 0.0
        gaps = np.asarray(scipy.spatial.cKDTree(self.p_PT).query(self.p_PT, k=2)[0])
        return 0.5 * float(np.median(gaps[:, 1]))

    @functools.cached_property
    def stretch(self) -> FloatArray:
        """How much longer than wide the cells are, and in which direction, shape (3,), see `find_stretch`."""
        return _fixed(find_stretch(self.p_PT, self.n_PT))

    @functools.cached_property
    def points(self) -> FloatArray:
        """Point of the object's surface under each cell, shape (n, 3), m; NaN for dead cells.

        [B16] eq. 5.1, before the mean is subtracted.
        """
        return _fixed(self.p_PT - (self.alpha * self.pressure)[:, None] * self.n_PT)


def describe_patch(
    p_PT: ArrayLike,
    pressure: ArrayLike,
    *,
    alpha: float,
    n_PT: ArrayLike | None = None,
    threshold: float = 0.0,
    saturation: float | None = None,
    misplacement: ArrayLike | None = None,
    params: PatchParams = PatchParams(),
) -> Patch:
    """Describes a frame of a tactile array by its principal components. [B16] eqs. 5.1 to 5.3.

    Args:
        p_PT: positions of the pad's cells, on the undeformed pad, shape (n, 3), m.
        pressure: of each cell, shape (n,), Pa, >= 0; NaN marks a dead cell.
        alpha: depth of the object's surface in the pad over the pressure, m/Pa; for a soft layer on a stiff core its
            thickness over its modulus. Negative only without `n_PT`.
        n_PT: outward unit normals of the pad at the cells, out of the finger, shape (n, 3). Without them the pad must
            be flat, and as in [B16] eq. 5.1 the pressure counts along its z axis, the normal of its plane on the side
            of the z axis of the cells' frame: with a positive alpha this points into the pad, with a negative one out
            of it.
        threshold: a cell is active above this pressure, Pa.
        saturation: the highest pressure that a cell can read, Pa; None or infinite without a limit.
        misplacement: covariance of the pad's pose error: a shift, and a small rotation about the mean of its cells,
            shape (6, 6), m and rad, in the cells' frame. None if unknown; users of the patch then assume one.
        params: thresholds on the shape of pads and patches.

    Raises:
        InvalidInputError: no cell, no live cell, a shape that does not fit, a position or normal that is not finite,
            cells that are evidently in millimetres, a pressure below zero or infinite, an alpha, threshold or
            saturation out of range, a depth beyond 0.1 m, normals missing where the pad is curved or parallel to the z
            axis, or a misplacement that is not a covariance.
    """
    instance_of("params", params, PatchParams)
    p_PT = checked_cells(p_PT)
    pressure = checked_pressures(pressure, len(p_PT))
    alpha = float(limited("alpha", alpha, (), most=MOST_ALPHA))
    if n_PT is None:
        n_PT = np.tile(-math.copysign(1.0, alpha) * _flat_normal(p_PT, params), (len(p_PT), 1))
    elif alpha < 0:
        raise InvalidInputError(f"alpha must be a number >= 0 if n_PT is given, not {alpha:g}.")
    else:
        n_PT = unit_vectors("n_PT", n_PT, p_PT.shape)
    threshold, saturation = checked_range(threshold, saturation)
    check_depths(abs(alpha), pressure, threshold)
    unknown = np.full((3, 3), np.nan)
    patch = Patch(
        p_PT,
        n_PT,
        pressure,
        abs(alpha),
        threshold,
        saturation,
        "no_contact",
        unknown[0],
        unknown,
        unknown,
        unknown[0],
        None if misplacement is None else checked_covariance(misplacement),
    )
    found = _with_components(patch, params)
    seal(found)
    return found


def _fixed(array: _Array) -> _Array:
    array.setflags(write=False)
    return array


def _flat_normal(p_PT: FloatArray, params: PatchParams) -> FloatArray:
    """The normal, nearest to z, of the plane of cells (n, 3), or across a row of cells, or of a single cell."""
    _, extents, axes = np.linalg.svd(np.vstack([p_PT - p_PT.mean(axis=0), np.zeros((3, 3))]), full_matrices=False)
    across = axes[extents <= params.flat_share * extents[0]]
    if len(across) == 0:
        raise InvalidInputError("n_PT must be the normals of a curved pad, whose cells are not in a plane, not None.")
    normal: FloatArray = across.T @ across[:, 2]
    rise = float(np.linalg.norm(normal))
    if rise < params.least_rise:
        raise InvalidInputError(
            "n_PT must be the normals of a pad that is parallel to the z axis, which cannot tell its side, not None."
        )
    return normal / rise


def _with_components(patch: Patch, params: PatchParams) -> Patch:
    """The patch with its principal components as far as they are determined."""
    points, cells = patch.points[patch.active], patch.p_PT[patch.active]
    if len(points) == 0:
        return patch
    centroid = points.mean(axis=0)
    inward = np.nan_to_num(patch.inward)
    flat = cells - cells.mean(axis=0)
    extents = np.linalg.svd(flat - np.outer(flat @ inward, inward), compute_uv=False)
    if extents[0] < _LEAST_EXTENT:
        return dataclasses.replace(patch, status="point", centroid=centroid)
    covariance = np.cov(points.T)  # [B16] eq. 2.33
    rising, axes = np.linalg.eigh(covariance)
    eigenvalues, eigenvectors = np.maximum(rising[::-1], 0.0), axes[:, ::-1]
    if eigenvectors[:, 0] @ (patch.p_PT[-1] - patch.p_PT[0]) < 0:
        eigenvectors = eigenvectors * [-1.0, 1.0, 1.0]

    status: PatchStatus
    if len(points) == 2 or extents[1] <= params.flat_share * extents[0]:
        status = "row"
        eigenvalues = np.array([eigenvalues[0], np.nan, np.nan])
        eigenvectors = np.where([True, False, False], eigenvectors, np.nan)
    else:
        third = eigenvectors[:, 2] * math.copysign(1.0, float(eigenvectors[:, 2] @ inward))
        eigenvectors = np.stack([eigenvectors[:, 0], np.cross(third, eigenvectors[:, 0]), third], axis=1)
        status = "area" if third @ inward >= params.least_alignment else "narrow"
    return dataclasses.replace(
        patch,
        status=status,
        centroid=centroid,
        covariance=covariance,
        eigenvectors=eigenvectors,
        eigenvalues=eigenvalues,
    )
