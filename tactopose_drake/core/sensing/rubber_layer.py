"""A pad of rubber, whose pressure is not the depth of what is pressed into it.

Rubber keeps its volume: what a contact pushes down has to flow to the contact's rim. In a layer of the thickness h on a
stiff core, thin against the contact, the pressure p of a smooth contact that presses it in by d obeys

    (1 - 2 nu) / (2 mu (1 - nu)) h p - h^3 / (3 mu) laplace p = d,    p = 0 outside the contact,

with the shear modulus mu and Poisson's ratio nu [CV20]. The first term alone is a bed of springs (Winkler's), the
second the layer that cannot be compressed. With the springs' pressure p_w it is

    p - l^2 laplace p = p_w,    l = h sqrt(2 (1 - nu) / (3 (1 - 2 nu))).

So a flat thing's pressure is a dome, highest in the middle of the contact. Cells then read less than in proportion
where the pressure is high, and more on the way back than on the way up.

Source: [CV20] T. Chandler, D. Vella, Validity of Winkler's mattress model for thin elastomeric layers: beyond Poisson's
ratio, Proceedings of the Royal Society A 476, 20200551, 2020.
"""

import dataclasses

import numpy as np
import scipy
from numpy.typing import NDArray

from tactopose_drake.core.sensing.tactile_layout import TactileLayout
from tactopose_drake.core.validation import FloatArray, positive_number

_MOST_CONFINEMENT = 10.0  # m
_RIM = 0.02  # of the highest pressure, below which a cell is at a contact's rim
_MOST_HYSTERESIS = 0.24  # beyond a quarter a cell would read less where it is pressed more


@dataclasses.dataclass(kw_only=True, slots=True)
class RubberLayer:
    """How the layer over an array's cells, and the cells, differ from springs."""

    # How far rubber shares pressure within a contact, m: thickness sqrt(2 (1 - nu) / (3 (1 - 2 nu))). 0: springs, side
    # by side; much more than a contact is wide: rubber that cannot be compressed.
    confinement: float = 0.0
    half_pressure: float = 1.0e12  # on a cell at which it reads half of that, Pa
    # By how much a cell reads more on the way back, at the most, as a share of the highest pressure since it was
    # touched; below a quarter.
    hysteresis: float = 0.0

    def validate(self) -> None:
        """Raises InvalidInputError if a number is out of its range."""
        positive_number("RubberLayer.confinement", self.confinement, allow_zero=True, most=_MOST_CONFINEMENT)
        positive_number("RubberLayer.half_pressure", self.half_pressure)
        positive_number("RubberLayer.hysteresis", self.hysteresis, allow_zero=True, most=_MOST_HYSTERESIS)


@dataclasses.dataclass(frozen=True, eq=False)
class CellNeighbours:
    """Which cells of an array lie side by side.

    Attributes:
        conductance: edge over distance between the centres of two neighbours, else 0, shape (m, m).
        outward: the same of each edge, to the outside at the edge, shape (m, 4).
        others: the neighbour at each edge, or -1, shape (m, 4).
        areas: shape (m,), m^2.
    """

    conductance: FloatArray
    outward: FloatArray
    others: NDArray[np.int64]
    areas: FloatArray


def find_neighbours(layout: TactileLayout) -> CellNeighbours:
    """The neighbours of an array's cells: those whose edges' middles are nearer to each other than half a cell."""
    m, corners = len(layout), layout.corners
    ends = np.roll(corners, -1, axis=1)
    middles, lengths = 0.5 * (corners + ends), np.linalg.norm(ends - corners, axis=2).ravel()
    arms = np.linalg.norm(middles - layout.p_TC[:, None], axis=2).ravel()
    flat = middles.reshape(-1, 3)
    # Of a cell's four edges and one of another cell, the nearest to an edge.
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
    """The pressure on the cells of a rubber layer, given that of springs, shape (m,), Pa.

    By finite volumes on the cells that are touched, with no pressure at the edges of what is not. Cells of which the
    contact covers hardly anything are its rim, and keep their pressure. The force on all cells stays what it was, for
    it is the hand's; only the stiffness is another.
    """
    within = pressure > _RIM * pressure.max()
    touched = np.flatnonzero(within)
    if confinement == 0.0 or len(touched) == 0:
        return pressure
    is_touched = np.append(within, False)  # the last is no neighbour
    at_rim = ~is_touched[neighbours.others[touched]]
    flow = -neighbours.conductance[np.ix_(touched, touched)]
    flow -= np.diag(flow.sum(axis=1) - np.sum(neighbours.outward[touched], axis=1, where=at_rim))
    areas = neighbours.areas[touched]
    found = np.linalg.solve(np.diag(areas) + confinement**2 * flow, areas * pressure[touched])
    confined = pressure.copy()
    confined[touched] = found * (areas @ pressure[touched]) / (areas @ found)
    return confined


def cell_response(pressure: FloatArray, peak: FloatArray, rubber: RubberLayer) -> FloatArray:
    """What cells make of the pressures on them: less than in proportion, and more on the way back.

    The loop closes at no pressure and at the peak; half way down it is widest. Smaller loops within are left out.

    Args:
        pressure: on each cell, shape (m,), Pa.
        peak: the highest on each since it was touched, this one included, shape (m,), Pa.
        rubber: valid.
    """
    share = np.divide(pressure, peak, out=np.zeros_like(pressure), where=peak > 0.0)
    back = pressure + 4.0 * rubber.hysteresis * pressure * (1.0 - share)
    response: FloatArray = back / (1.0 + back / rubber.half_pressure)
    return response
