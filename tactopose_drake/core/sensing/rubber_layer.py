"""A rubber pad, whose pressure is not proportional to the local depth.

Rubber is nearly incompressible: material displaced by a contact must flow to the contact's rim. In a layer of thickness
h on a stiff core, thin against the contact, the pressure p under a smooth contact that presses it in by d obeys

    (1 - 2 nu) / (2 mu (1 - nu)) h p - h^3 / (3 mu) laplace p = d,    p = 0 outside the contact,

with the shear modulus mu and Poisson's ratio nu [CV20]. The first term alone is a bed of springs (Winkler's), the
second alone an incompressible layer. With the springs' pressure p_w it is

    p - l^2 laplace p = p_w,    l = h sqrt(2 (1 - nu) / (3 (1 - 2 nu))).

So the pressure under a flat object is a dome, highest in the middle of the contact. In addition, cells saturate at high
pressure, and have hysteresis: they read more during unloading than during loading.

Source: [CV20] T. Chandler, D. Vella, Validity of Winkler's mattress model for thin elastomeric layers: beyond Poisson's
ratio, Proceedings of the Royal Society A 476, 20200551, 2020.
"""

import dataclasses

import numpy as np
import scipy
from numpy.typing import NDArray

from tactopose_drake.core.parameter_checks import check_numbers
from tactopose_drake.core.sensing.tactile_layout import TactileLayout
from tactopose_drake.core.validation import FloatArray

_MOST_CONFINEMENT = 10.0  # m
_RIM = 0.02  # share of the highest pressure below which a cell is at a contact's rim
_MOST_HYSTERESIS = 0.24  # beyond a quarter a cell's reading would fall with its pressure


@dataclasses.dataclass(kw_only=True, slots=True)
class RubberLayer:
    """How the layer over an array's cells, and the cells' response, differ from linear springs."""

    # Length over which rubber spreads pressure within a contact, m: thickness sqrt(2 (1 - nu) / (3 (1 - 2 nu))). 0:
    # independent springs; much more than the width of a contact: incompressible rubber.
    confinement: float = 0.0
    half_pressure: float = 1.0e12  # pressure on a cell of which it reads half, Pa
    # Largest excess of a cell's reading during unloading, as a share of the highest pressure since it was touched;
    # below a quarter.
    hysteresis: float = 0.0

    def validate(self) -> None:
        """Raises InvalidInputError if a number is out of its range."""
        most = {"confinement": _MOST_CONFINEMENT, "hysteresis": _MOST_HYSTERESIS}
        check_numbers("RubberLayer", self, may_be_zero=most, most=most)


@dataclasses.dataclass(frozen=True, eq=False)
class CellNeighbours:
    """Adjacency of an array's cells.

    Attributes:
        conductance: edge length over centre distance of two neighbours, else 0, shape (m, m).
        outward: edge length over the distance from the centre to the edge, for each edge, shape (m, 4).
        others: index of the neighbour at each edge, or -1, shape (m, 4).
        areas: shape (m,), m^2.
    """

    conductance: FloatArray
    outward: FloatArray
    others: NDArray[np.int64]
    areas: FloatArray


def find_neighbours(layout: TactileLayout) -> CellNeighbours:
    """Finds neighbouring cells: those whose edges' midpoints are closer to each other than half a cell."""
    m, corners = len(layout), layout.corners
    ends = np.roll(corners, -1, axis=1)
    middles, lengths = 0.5 * (corners + ends), np.linalg.norm(ends - corners, axis=2).ravel()
    arms = np.linalg.norm(middles - layout.p_TC[:, None], axis=2).ravel()
    flat = middles.reshape(-1, 3)
    # The five nearest edges to each one: at most the four of its own cell, and the nearest of another.
    nearest = scipy.spatial.cKDTree(flat).query(flat, k=min(5, 4 * m))
    gaps, edges = np.asarray(nearest[0]), np.asarray(nearest[1])
    others, conductance = np.full((m, 4), -1), np.zeros((m, m))
    for e, (gap, edge) in enumerate(zip(gaps, edges, strict=True)):
        of_others = np.flatnonzero(edge // 4 != e // 4)
        if len(of_others) == 0:
            continue
        f, way = int(edge[of_others[0]]), float(gap[of_others[0]])
        if way < 0.5 * (arms[e] + arms[f]):
            i, j = e // 4, f // 4
            others[i, e % 4] = j
            conductance[i, j] = conductance[j, i] = 0.5 * (lengths[e] + lengths[f]) / (arms[e] + arms[f] + way)
    lengths, arms = lengths.reshape(m, 4), arms.reshape(m, 4)
    return CellNeighbours(conductance, lengths / arms, others, layout.areas)


def confined_pressure(pressure: FloatArray, neighbours: CellNeighbours, confinement: float) -> FloatArray:
    """The pressure on the cells of a rubber layer from that of springs, shape (m,), Pa.

    Solved by finite volumes on the cells that are touched, with zero pressure at the edges of the others. Cells hardly
    covered by the contact are its rim, and keep their pressure. The total force is preserved, as the hand determines
    it; only the stiffness changes.
    """
    within = pressure > _RIM * pressure.max()
    touched = np.flatnonzero(within)
    if confinement == 0.0 or len(touched) == 0:
        return pressure
    is_touched = np.append(within, False)  # index -1 stands for no neighbour
    at_rim = ~is_touched[neighbours.others[touched]]
    flow = -neighbours.conductance[np.ix_(touched, touched)]
    flow -= np.diag(flow.sum(axis=1) - np.sum(neighbours.outward[touched], axis=1, where=at_rim))
    areas = neighbours.areas[touched]
    found = np.linalg.solve(np.diag(areas) + confinement**2 * flow, areas * pressure[touched])
    confined = pressure.copy()
    confined[touched] = found * (areas @ pressure[touched]) / (areas @ found)
    return confined


def cell_response(pressure: FloatArray, peak: FloatArray, rubber: RubberLayer) -> FloatArray:
    """The reading of cells from the pressures on them, with saturation and hysteresis.

    The hysteresis loop closes at zero pressure and at the peak, and is widest halfway. Minor loops are not modelled.

    Args:
        pressure: on each cell, shape (m,), Pa.
        peak: the highest pressure on each since it was touched, including this one, shape (m,), Pa.
        rubber: valid.
    """
    share = np.divide(pressure, peak, out=np.zeros_like(pressure), where=peak > 0.0)
    back = pressure + 4.0 * rubber.hysteresis * pressure * (1.0 - share)
    response: FloatArray = back / (1.0 + back / rubber.half_pressure)
    return response
