"""What a tactile array reads: the pressure field on a contact surface, through its soft layer and its electronics.

The field is given as the simulator's hydroelastic contact has it: convex polygons with a pressure that is linear on
each. A cell's reading is the mean normal pressure on its area: the part of the field inside its wedge is integrated
exactly, whatever the polygons' size.
"""

import dataclasses
import math

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from tactopose_drake.core.sensing.rubber_layer import RubberLayer
from tactopose_drake.core.sensing.tactile_kernels import cell_forces, faces_are_valid
from tactopose_drake.core.sensing.tactile_layout import TactileLayout
from tactopose_drake.core.validation import FloatArray, finite_array, positive_number
from tactopose_drake.errors import InvalidInputError

_REACH = 6.0  # standard deviations, beyond which a Gaussian is nothing
_MOST_POINTS = 16  # along a cell's edge


@dataclasses.dataclass(frozen=True, eq=False)
class PressureField:
    """A pressure on polygons, as it acts on a pad.

    Attributes:
        vertices: in the pad's frame T, shape (n, 3), m.
        pressure: at the vertices, shape (n,), Pa; linear over each face.
        faces: flat convex polygons, each as its number of vertices followed by their indices, one after the other;
            counterclockwise for who looks at the pad from outside.

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
            raise InvalidInputError(f"faces: are not polygons of the {len(vertices)} vertices.")
        object.__setattr__(self, "faces", faces)

    @classmethod
    def none(cls) -> "PressureField":
        """Where nothing touches the pad."""
        return cls(np.zeros((0, 3)), np.zeros(0), np.zeros(0, dtype=np.int64))


@dataclasses.dataclass(kw_only=True, slots=True)
class TactileModel:
    """What limits a tactile array; the defaults are an ideal one."""

    range: float = 1.0e12  # largest pressure that a cell reads, Pa
    resolution: float = 0.0  # quantisation step, Pa; 0: none
    noise: float = 0.0  # standard deviation, Pa
    spread: float = 0.0  # how far the soft layer spreads a point force, one standard deviation, m; 0: not at all
    rubber: RubberLayer | None = None  # how layer and cells differ from springs; null: not at all
    # Cells that give no reading, or one that tells nothing, such as a number that never changes. What they show does
    # not count.
    dead_cells: list[int] = dataclasses.field(default_factory=list)

    def validate(self, cells: int) -> None:
        """Checks every field.

        Args:
            cells: how many the array has.

        Raises:
            InvalidInputError: a range <= 0, another number < 0, or a dead cell that does not exist.
        """
        positive_number("TactileModel.range", self.range)
        for name in ("resolution", "noise", "spread"):
            positive_number(f"TactileModel.{name}", getattr(self, name), allow_zero=True)
        if self.rubber is not None:
            self.rubber.validate()
        for cell in self.dead_cells:
            if not 0 <= cell < cells:
                raise InvalidInputError(
                    f"TactileModel.dead_cells: holds {cell}; allowed are the cells' indices, 0 to {cells - 1}."
                )


@dataclasses.dataclass(frozen=True, eq=False)
class TactileFrame:
    """One reading of a tactile array.

    Attributes:
        pressure: of each cell, shape (m,), Pa, >= 0; NaN where the cell is dead.
        saturated: which cells are at the end of their range, shape (m,).
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

    The contact lies in the soft layer, where a cell of a round pad is narrower than on its outside. So it reads less
    than depth over `alpha` says: at a depth of 1 mm 12 % less where the pad's radius is 7 mm.

    Args:
        layout: the cells.
        fields: of all that touches the pad.

    Returns:
        Shape (m,), Pa; what turns away from a cell, or lies beyond every cell's edges, is not felt.
    """
    pressure: FloatArray = -np.einsum("mi,mi->m", forces_on_cells(layout, fields), layout.n_T) / layout.areas
    return np.maximum(pressure, 0.0)  # at a contact's rim, where it is zero, rounding may make it less


def forces_on_cells(layout: TactileLayout, fields: list[PressureField]) -> FloatArray:
    """The force that the pressure exerts on each cell, in T, shape (m, 3), N."""
    forces = np.zeros((len(layout), 3))
    for field in fields:
        cell_forces(field.vertices, field.pressure, field.faces, layout.planes, layout.n_T, forces)
    return forces


def spread_matrix(layout: TactileLayout, spread: float) -> FloatArray:
    """How a soft layer on the cells shares the pressure on one cell with the others.

    A force that is spread evenly over one cell arrives at each cell in proportion to the integral of a Gaussian over
    both cells' areas (by sums over points half a standard deviation apart, and 16 along an edge at the most: less than
    an eighth of a cell hardly reaches the next). Nothing is lost: the force on all cells stays what it was. Under a
    point load, the pressure below a layer is as wide at half its height as a Gaussian whose standard deviation is half
    the layer's thickness (Boussinesq's solution for the half-space).

    Args:
        layout: the cells.
        spread: the Gaussian's standard deviation, m; 0 shares nothing.

    Returns:
        Shape (m, m): shared pressure = matrix @ pressure.
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
    """Points evenly within each cell, about `spacing` apart, and the same number in all; shape (m, k, 3), m."""
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
    """What the electronics make of the pressures on the cells: noise, range, quantisation, dead cells, in this order.

    Args:
        pressure: on each cell, after the soft layer, shape (m,), Pa.
        normal_noise: standard normal numbers, shape (m,).
        model: the array's limits, valid.
    """
    signal = pressure + model.noise * np.asarray(normal_noise)
    reading = np.maximum(signal, 0.0)
    if model.resolution > 0:
        reading = model.resolution * np.round(reading / model.resolution)
    # The range need not be a whole number of steps; a cell at its end reads it all the same.
    reading = np.where(signal >= model.range, model.range, np.minimum(reading, model.range))
    reading[model.dead_cells] = np.nan
    return TactileFrame(reading, reading >= model.range)
