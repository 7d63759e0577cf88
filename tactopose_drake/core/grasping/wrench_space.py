"""The wrenches that frictional contacts can exert on an object, as a convex polytope around the origin.

A wrench is a torque about the object's centre of mass, divided by a length to make it a force, and a force: (torque /
length, force), N. Each friction cone is linearised by an inscribed pyramid, so the result is contained in that of round
cones. How hard the fingers may press is bounded in one of two ways [FC92]:

- "L1": the normal forces together are at most 1 N; the space is the convex hull of all the cones' edges.
- "Linf": each normal force is at most 1 N; the space is the Minkowski sum of the contacts' own hulls.

The largest scaled set that fits into the space touches one of its facets. All facets of a hull of some forty points are
computed at once; a Minkowski sum has a hundred thousand. Of those only the ones near the fitted set are computed: a
hull of some of the sum's points is grown at its critical facets until these are facets of the sum itself, which makes
the answer exact.

Sources: [FC92] C. Ferrari and J. Canny, Planning optimal grasps, ICRA 1992. [B99] C. Borst et al., A fast and robust
grasp planner for arbitrary 3D objects, ICRA 1999.
"""

import dataclasses
from collections.abc import Callable
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog, nnls
from scipy.spatial import ConvexHull

from tactopose_drake.core.poses import axes_across
from tactopose_drake.core.validation import FloatArray

Norm = Literal["L1", "Linf"]

# Relative rounding error for wrenches of about 1 N.
_FLAT = 1e-7
# Accuracy of the critical facet, N: some digits above the hulls' own rounding errors.
_EXACT = 1e-9
# Floor of the demand along a direction, so that the division by it stays finite.
_NO_DEMAND = 1e-300
# Number of directions in one product, which bounds the memory.
_DIRECTIONS_A_BATCH = 1024


@dataclasses.dataclass(frozen=True, kw_only=True)
class HullGrowthParams:
    """How fast a hull of some points of a Minkowski sum grows, which does not affect the result."""

    first_facets: int = 64  # number of facets for which the first hull has support points
    facets_per_round: int = 32  # number of facets pushed out in one round


class Hull(NamedTuple):
    """A full-dimensional convex hull in d dimensions.

    Attributes:
        normals: outward unit normals of its facets, shape (f, d).
        offsets: their distances from the origin along the normals, shape (f,).
        vertices: shape (v, d).
        simplices: the facets' corners, rows of `vertices`, anticlockwise seen from outside in three dimensions, (f, d).
        volume: the d-dimensional volume.
    """

    normals: FloatArray
    offsets: FloatArray
    vertices: FloatArray
    simplices: NDArray[np.int32]
    volume: float


def convex_hull(points: FloatArray) -> Hull | None:
    """The convex hull of points (n, d); None if they lie in a hyperplane, up to rounding.

    The points are joggled by about 1e-10 of their size: the edges of a friction pyramid are coplanar, and Qhull may
    neither separate nor merge the resulting facets.
    """
    spread = points - points.mean(axis=0)
    values = np.linalg.svd(spread, compute_uv=False)
    if len(points) <= points.shape[1] or values[-1] <= _FLAT * values[0]:
        return None
    hull = ConvexHull(points, qhull_options="QJ")
    row = np.zeros(len(points), dtype=np.int32)
    row[hull.vertices] = np.arange(len(hull.vertices))
    normals, vertices, simplices = hull.equations[:, :-1], points[hull.vertices], row[hull.simplices]
    if points.shape[1] == 3:
        a, b, c = np.swapaxes(vertices[simplices], 0, 1)
        inwards = np.einsum("fi,fi->f", np.cross(b - a, c - a), normals) < 0.0
        simplices[inwards] = simplices[inwards][:, ::-1]
    return Hull(normals, -hull.equations[:, -1], vertices, simplices, hull.volume)


@dataclasses.dataclass(frozen=True, eq=False)
class WrenchSpace:
    """The wrenches that k contacts can exert.

    Attributes:
        primitives: wrenches of the edges of each contact's friction pyramid, normal forces of 1 N, shape (k, e, 6).
        norm: what bounds the forces, see the module.
        growth: how the hull of a Minkowski sum grows.
    """

    primitives: FloatArray
    norm: Norm = "L1"
    growth: HullGrowthParams = HullGrowthParams()

    @cached_property
    def is_force_closure(self) -> bool:
        """Whether contacts that press hard enough resist any wrench: whether the primitives positively span R^6."""
        rows = self.primitives.reshape(-1, 6)
        if not len(rows) or np.linalg.matrix_rank(rows, tol=_FLAT * np.abs(rows).max()) < 6:
            return False
        # Equivalently, a combination of all primitives with coefficients of at least one vanishes.
        _, residual = nnls(rows.T, -rows.sum(axis=0))
        return bool(residual <= _FLAT * len(rows))

    @cached_property
    def radius(self) -> float:
        """Radius of the largest ball about the origin in the space, N; 0 without force closure. [FC92]

        Five contacts of eight edges take about 7 ms with "L1". With "Linf" they take some 0.2 s, and up to 7 s if the
        fingers are placed so regularly that many facets are equally near.
        """
        return self.fit(lambda normals: np.ones(len(normals)))

    def scale(self, wrenches: FloatArray) -> float:
        """The largest multiple of disturbing wrenches (t, 6), N, that the contacts resist, each one at a time.

        Contacts without force closure, such as fingers under an object, may still resist some wrenches.
        Wrenches are (torque / length, force) as in the module. Zero wrenches demand nothing; the scale of a set of
        nothing else is infinite, unless there is no force closure.
        """
        if not np.any(wrenches):
            return np.inf if self.is_force_closure else 0.0
        if not self.is_force_closure:
            return self._scale_without_closure(wrenches)
        return self.fit(lambda normals: _support(normals, -wrenches))

    def _scale_without_closure(self, wrenches: FloatArray) -> float:
        """`scale` of a space that may be flat, with the origin on its boundary: by a linear program for each wrench."""
        edges, least = self.primitives.reshape(-1, 6), np.inf
        bounded = np.repeat(np.eye(len(self.primitives)), self.primitives.shape[1], axis=1)
        if self.norm == "L1":
            bounded = bounded.sum(axis=0, keepdims=True)
        bounded = np.column_stack([bounded, np.zeros(len(bounded))])
        for size, wrench in zip(np.linalg.norm(wrenches, axis=1), wrenches, strict=True):
            if size == 0.0:
                continue
            # By rounding, a program resists a little of any wrench: those outside of the cone are told first.
            if not len(edges) or nnls(edges.T, -wrench / size)[1] > _FLAT:
                return 0.0
            balance = np.column_stack([edges.T, wrench / size])
            cost = np.append(np.zeros(len(edges)), -1.0)
            found = linprog(cost, bounded, np.ones(len(bounded)), balance, np.zeros(6))
            assert found.x is not None, "the program is feasible, by zero forces, and bounded"
            least = min(least, float(found.x[-1] / size))
        return least

    @cached_property
    def volume(self) -> float:
        """Volume of the space, N^6; 0 if it is flat.

        With "Linf" all facets of the Minkowski sum are needed, which took one core 1.4 s for three contacts of eight
        edges and 30 s for four.
        """
        hull = convex_hull(self.vertices)
        return 0.0 if hull is None else hull.volume

    @cached_property
    def vertices(self) -> FloatArray:
        """Points whose convex hull is the space, including the origin, shape (v, 6); see `volume`."""
        return self._points(slice(0, 6))

    def projection(self, part: Literal["torque", "force"]) -> Hull | None:
        """The torques, or the forces, of the wrenches in the space, in three dimensions; None if they are flat."""
        return convex_hull(self._points(slice(0, 3) if part == "torque" else slice(3, 6)))

    def _points(self, columns: slice) -> FloatArray:
        """Points, including the origin, whose hull is the projection of the space on some components."""
        primitives = self.primitives[..., columns]
        points = np.zeros((1, primitives.shape[2]))
        if self.norm == "L1":
            return np.concatenate([points, primitives.reshape(-1, primitives.shape[2])])
        for edges in primitives:
            points = (points[:, None] + np.concatenate([np.zeros_like(points[:1]), edges])).reshape(-1, points.shape[1])
            hull = convex_hull(points)
            points = points if hull is None else hull.vertices
        return points

    def fit(self, demand: Callable[[FloatArray], FloatArray]) -> float:
        """How far a convex set about the origin can be scaled until it touches the space's surface.

        Args:
            demand: the set's support function, from unit directions (m, 6) to shape (m,).

        Returns:
            The scale; 0 without force closure.
        """
        if not self.is_force_closure:
            return 0.0
        points = self._first_points()
        least = np.inf
        while True:
            hull = convex_hull(points)
            if hull is None:
                return 0.0
            wanted = np.maximum(demand(hull.normals), _NO_DEMAND)
            scales = hull.offsets / wanted
            nearest = np.argsort(scales, kind="stable")[: self.growth.facets_per_round]
            supports, found = self.support(hull.normals[nearest])
            # A facet of the hull bounds the scale from below, the support plane of the space along it from above.
            least = min(least, float((supports / wanted[nearest]).min()))
            beyond = supports > hull.offsets[nearest] + _EXACT
            if not beyond.any() or least - scales[nearest[0]] <= _EXACT * max(1.0, least):
                return least if least > _FLAT else 0.0
            points = np.concatenate([hull.vertices, _distinct(found[beyond])])

    def support(self, directions: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The space's extent along directions (m, 6), shape (m,), N, and its points there, shape (m, 6)."""
        along = np.einsum("ked,md->mke", self.primitives, directions)
        edge = along.argmax(axis=2)
        best = np.take_along_axis(along, edge[..., None], axis=2)[..., 0]  # (m, k)
        wrench = self.primitives[np.arange(len(self.primitives)), edge]  # (m, k, 6)
        if self.norm == "L1" and len(self.primitives):
            contact = best.argmax(axis=1)[:, None]
            best = np.take_along_axis(best, contact, axis=1)
            wrench = np.take_along_axis(wrench, contact[..., None], axis=1)
        pressing = best > 0.0
        return np.sum(best * pressing, axis=1), np.sum(wrench * pressing[..., None], axis=1)

    def _first_points(self) -> FloatArray:
        """Points of the space whose hull is the first one; for "L1" these are all its vertices."""
        points = np.concatenate([np.zeros((1, 6)), self.primitives.reshape(-1, 6)])
        if self.norm == "L1":
            return points
        hull = convex_hull(points)
        if hull is None:
            return points
        nearest = np.argsort(hull.offsets, kind="stable")[: self.growth.first_facets]
        return np.concatenate([points, _distinct(self.support(hull.normals[nearest])[1])])


def cone_wrenches(p_GC: FloatArray, n: FloatArray, friction: float, edges: int, length: float) -> FloatArray:
    """The wrenches of the edges of contacts' friction pyramids, with normal forces of 1 N.

    Args:
        p_GC: contact points from the centre of mass, shape (..., 3), m.
        n: the object's outward unit normals there, shape (..., 3); fingers press against them.
        friction: coefficient.
        edges: of a pyramid; without friction there is only one, the normal force.
        length: by which torques are divided, m.

    Returns:
        Shape (..., edges, 6), torque first, in the axes of the arguments.
    """
    t1, t2 = axes_across(n)
    angle = np.arange(edges if friction > 0.0 else 1) * (2.0 * np.pi / edges)
    around = np.cos(angle)[:, None] * t1[..., None, :] + np.sin(angle)[:, None] * t2[..., None, :]
    force = friction * around - n[..., None, :]
    return np.concatenate([np.cross(p_GC[..., None, :], force) / length, force], axis=-1)


def _support(directions: FloatArray, points: FloatArray) -> FloatArray:
    """The largest products of points (t, 6) and the origin with directions (m, 6), shape (m,)."""
    extent = np.zeros(len(directions))
    for first in range(0, len(directions), _DIRECTIONS_A_BATCH):
        batch = slice(first, first + _DIRECTIONS_A_BATCH)
        extent[batch] = (directions[batch] @ points.T).max(axis=1, initial=0.0)
    return extent


def _distinct(points: FloatArray) -> FloatArray:
    """The points (n, 6) without duplicates up to rounding."""
    _, first = np.unique(points.round(10), axis=0, return_index=True)
    return points[first]
