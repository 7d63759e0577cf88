"""The readings of a tactile array: a pressure field on a contact surface, through a soft layer and the electronics.

The field has the form of a simulator's hydroelastic contact: convex polygons with a linear pressure on each. A cell's
reading is the mean normal pressure on its area: the part of the field inside its wedge is integrated exactly, whatever
the polygons' size.
"""

import dataclasses
import math

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from tactopose_drake.core.sensing.rubber_layer import RubberLayer
from tactopose_drake.core.sensing.tactile_kernels import cell_forces, faces_are_valid
from tactopose_drake.core.sensing.tactile_layout import TactileLayout
from tactopose_drake.core.validation import FloatArray, finite_array, positive_number, whole_number
from tactopose_drake.errors import InvalidInputError

_REACH = 6.0  # standard deviations beyond which a Gaussian is neglected
_MOST_POINTS = 16  # quadrature points along a cell's edge


@dataclasses.dataclass(frozen=True, eq=False)
class PressureField:
    """A pressure on polygons, as it acts on a pad.

    Attributes:
        vertices: in the pad's frame T, shape (n, 3), m.
        pressure: at the vertices, shape (n,), Pa; linear over each face.
        faces: flat convex polygons, each as its number of vertices followed by their indices, concatenated;
            counterclockwise as seen from outside the pad.

    Raises:
        InvalidInputError: numbers that are not finite, or faces that are incomplete or name vertices that do not exist.
    """

    vertices: FloatArray
    pressure: FloatArray
    faces: NDArray[np.int64]

    def __post_init__(self) -> None:
        vertices = finite_array("vertices", self.vertices, (None, 3))
        object.__setattr__(self, "vertices", vertices)
        object.__setattr__(self, "pressure", finite_array("pressure", self.pressure, (len(vertices),)))
        faces = np.asarray(self.faces, dtype=np.int64).ravel()
        if not faces_are_valid(faces, len(vertices)):
            raise InvalidInputError(f"faces must be polygons of the {len(vertices)} vertices.")
        object.__setattr__(self, "faces", faces)

    @classmethod
    def none(cls) -> "PressureField":
        """The field without any contact."""
        return cls(np.zeros((0, 3)), np.zeros(0), np.zeros(0, dtype=np.int64))


@dataclasses.dataclass(kw_only=True, slots=True)
class TactileModel:
    """The limits of a tactile array; the defaults are an ideal one."""

    range: float = 1.0e12  # largest pressure that a cell reads, Pa
    resolution: float = 0.0  # quantisation step, Pa; 0: none
    noise: float = 0.0  # standard deviation, Pa
    spread: float = 0.0  # standard deviation with which the soft layer spreads a point force, m; 0: none
    rubber: RubberLayer | None = None  # how layer and cells differ from springs; null: not at all
    # Cells without a reading, or with a useless one, such as a number that never changes. Their readings are ignored.
    dead_cells: list[int] = dataclasses.field(default_factory=list)

    def validate(self, cells: int) -> None:
        """Checks every field.

        Args:
            cells: number of cells of the array.

        Raises:
            InvalidInputError: a range <= 0, another number < 0, or a dead cell that does not exist.
        """
        positive_number("TactileModel.range", self.range)
        for name in ("resolution", "noise", "spread"):
            positive_number(f"TactileModel.{name}", getattr(self, name), allow_zero=True)
        if self.rubber is not None:
            self.rubber.validate()
        for cell in self.dead_cells:
            whole_number("TactileModel.dead_cells", cell, least=0, most=cells - 1)


@dataclasses.dataclass(frozen=True, eq=False)
class TactileFrame:
    """One reading of a tactile array.

    Attributes:
        pressure: of each cell, shape (m,), Pa, >= 0; NaN for dead cells.
        saturated: whether each cell is at the end of its range, shape (m,).
    """

    pressure: FloatArray
    saturated: NDArray[np.bool_]

    @property
    def status(self) -> str:
        """One of "ok", "no contact", or "saturated: " and the cells."""
        if self.saturated.any():
            return "saturated: " + ", ".join(str(cell) for cell in np.flatnonzero(self.saturated))
        return "ok" if np.any(self.pressure > 0) else "no contact"


def mean_pressure(layout: TactileLayout, fields: list[PressureField]) -> FloatArray:
    """The normal pressure on each cell, averaged over its area.

    The contact lies within the soft layer, where a cell of a round pad is narrower than on its outside. So it reads
    less than depth over `alpha`: 12 % less at a depth of 1 mm for a pad of radius 7 mm.

    Args:
        layout: the cells.
        fields: of everything that touches the pad.

    Returns:
        Shape (m,), Pa; faces that are turned away from a cell, or outside of every cell's edges, are not felt.
    """
    pressure: FloatArray = -np.einsum("mi,mi->m", forces_on_cells(layout, fields), layout.n_T) / layout.areas
    return np.maximum(pressure, 0.0)  # at a contact's rim, rounding may make it negative


def forces_on_cells(layout: TactileLayout, fields: list[PressureField]) -> FloatArray:
    """The force that the pressure exerts on each cell, in T, shape (m, 3), N."""
    forces = np.zeros((len(layout), 3))
    for field in fields:
        cell_forces(field.vertices, field.pressure, field.faces, layout.planes, layout.n_T, forces)
    return forces


def spread_matrix(layout: TactileLayout, spread: float) -> FloatArray:
    """The matrix by which a soft layer on the cells spreads pressure from each cell to the others.

    A force spread evenly over one cell arrives at each cell in proportion to the integral of a Gaussian over both
    cells' areas (by quadrature with points half a standard deviation apart, at most 16 along an edge: a spread below an
    eighth of a cell hardly reaches the next). The total force is preserved. Under a point load, the pressure below a
    layer has the half width of a Gaussian whose standard deviation is half the layer's thickness (Boussinesq's solution
    for the half-space).

    Args:
        layout: the cells.
        spread: the Gaussian's standard deviation, m; 0 spreads nothing.

    Returns:
        Shape (m, m): spread pressure = matrix @ pressure.
    """
    if spread == 0:
        return np.eye(len(layout))
    points = _points_in_cells(layout, 0.5 * spread)
    size = np.linalg.norm(layout.corners - layout.p_TC[:, None], axis=2).max()
    near = scipy.spatial.cKDTree(layout.p_TC).query_ball_point(layout.p_TC, _REACH * spread + 2.0 * size)
    # mean_a,b exp(-|a - b|^2 / 2 s^2) over the points a of one cell and b of another.
    arrives = np.zeros((len(layout), len(layout)))
    for a, others in enumerate(near):
        squared = scipy.spatial.distance.cdist(points[a], points[others].reshape(-1, 3), "sqeuclidean")
        shares = np.exp(-0.5 * squared / spread**2).reshape(points.shape[1], len(others), points.shape[1])
        arrives[a, others] = shares.mean(axis=(0, 2))
    share_of_force = layout.areas[:, None] * arrives
    share_of_force /= share_of_force.sum(axis=0)
    matrix: FloatArray = share_of_force * layout.areas / layout.areas[:, None]
    return matrix


def _points_in_cells(layout: TactileLayout, spacing: float) -> FloatArray:
    """A regular grid of points in each cell, about `spacing` apart, equally many in all; shape (m, k, 3), m."""
    a, b, c, d = layout.corners.transpose(1, 0, 2)[:, :, None]
    across, along = (
        math.ceil(min(np.linalg.norm(np.concatenate(edges), axis=2).max() / spacing, _MOST_POINTS))
        for edges in ([b - a, c - d], [d - a, c - b])
    )
    u, v = np.meshgrid((np.arange(across) + 0.5) / across, (np.arange(along) + 0.5) / along)
    u, v = u.reshape(1, -1, 1), v.reshape(1, -1, 1)
    points: FloatArray = (1 - v) * ((1 - u) * a + u * b) + v * ((1 - u) * d + u * c)
    return points


def read_cells(pressure: FloatArray, normal_noise: ArrayLike, model: TactileModel) -> TactileFrame:
    """The electronics' readings of the pressures on the cells: noise, range, quantisation, dead cells, in this order.

    Args:
        pressure: on each cell, after the soft layer, shape (m,), Pa.
        normal_noise: standard normal numbers, shape (m,).
        model: the array's limits, valid.
    """
    signal = pressure + model.noise * np.asarray(normal_noise)
    reading = np.maximum(signal, 0.0)
    if model.resolution > 0:
        reading = model.resolution * np.round(reading / model.resolution)
    # The range need not be a multiple of the resolution; a cell at its end reads the range itself.
    reading = np.where(signal >= model.range, model.range, np.minimum(reading, model.range))
    reading[model.dead_cells] = np.nan
    return TactileFrame(reading, reading >= model.range)
