"""Where a finger can touch an object at a given pose in the palm."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.grasping.finger_geometry import FingerGeometry
from tactopose_drake.core.grasping.finger_touches import FingerTouches
from tactopose_drake.core.parameter_checks import check_numbers
from tactopose_drake.core.poses import axes_across
from tactopose_drake.core.shape.signed_distance import DistanceGrid, PlacedGrid
from tactopose_drake.core.validation import FloatArray

# The best cosine between a finger's axis and the direction to the contact: at the fingertip's shoulder.
_BEST_FACING = 0.6
_PLACES = 3  # number of places along a fingertip's straight part at which it may touch
_WAITING = 300  # number of samples of the workspace that are candidates for waiting
_BEHIND = 0.1  # cosine by which a touch of the straight part may face backwards
_DEEPER = 0.0004  # by which the rest of a fingertip may be deeper in the object than its planned contact, m


@dataclass(kw_only=True, slots=True)
class ReachParams:
    """What counts as a clean touch."""

    stiffness: float = 5.0  # of each joint under the grasp controller, N m/rad; 1 rad is 5 cm of a sliding joint
    lift: float = 0.015  # distance of the open fingertip from the object, m
    clearance: float = 0.002  # least distance of the rest of the finger from the object, m
    least_alignment: float = 0.75  # least cosine between the normal and the motion of the closing fingertip
    least_facing: float = 0.12  # least cosine between the finger's axis and the direction to the contact: 0 at its side
    most_facing: float = 0.97  # largest such cosine: 1 at the fingertip's very end
    limit_margin: float = 0.03  # least distance from the joint limits in contact, rad; 1 rad is 5 cm of a sliding joint
    steps: int = 4  # number of Newton steps in the search for exact contact
    contact_tolerance: float = 1e-4  # largest distance of the fingertip from the surface after these steps, m
    approach_stops: int = 3  # number of postures between closed and open, with both, in which the finger must be clear
    outwards: float = 0.003  # displacement along the normal at which the surroundings of a touch are tested, m
    least_openness: float = 0.8  # least growth of the distance from the object over this displacement: less in corners
    sideways: float = 0.002  # displacement across the normal at which the surroundings are tested, m
    most_turn: float = 0.5  # largest rotation of the normal over it, rad: more at an edge rounded by less than 4 mm

    def validate(self) -> None:
        """Raises InvalidInputError if a value is not positive."""
        check_numbers("ReachParams", self)


@dataclass(frozen=True, eq=False)
class _Place:
    """A part of a fingertip that may touch: a sphere as thick as the fingertip.

    Attributes:
        p_SK: its centre in the sensor's frame, shape (3,), m.
        p_PK: the centre for each sample of the workspace, shape (n, 3), m.
        compliance: of the centre, shape (n, 3, 3), m/N.
        is_end: whether it is the round end, rather than on the straight part.
    """

    p_SK: FloatArray
    p_PK: FloatArray
    compliance: FloatArray
    is_end: bool


class FingerReach:
    """Samples of a finger's workspace, made once, from which touches on any object in any pose are found."""

    def __init__(
        self, geometry: FingerGeometry, params: ReachParams, generator: np.random.Generator, samples: int = 3000
    ) -> None:
        """Samples the workspace.

        Args:
            geometry: the finger.
            params: what counts as a clean touch.
            generator: source of the samples.
            samples: number of joint positions.
        """
        chain = geometry.chain
        self.geometry, self._params, self._arms = geometry, params, chain.arms
        margin = np.minimum(params.limit_margin * self._arms, 0.45 * (chain.upper - chain.lower))
        self._lower, self._upper = chain.lower + margin, chain.upper - margin
        self._q = generator.uniform(self._lower, self._upper, (samples, len(margin)))
        self._axis = chain.sensor_poses(self._q)[:, :, :3] @ _unit(geometry.p_ST - geometry.p_SR)
        self._end = self._place(geometry.p_ST, is_end=True)

    @property
    def reached(self) -> FloatArray:
        """Samples of the position of the fingertip's round end in P, shape (samples, 3), m."""
        return self._end.p_PK

    @property
    def compliance(self) -> FloatArray:
        """Compliance of the round end at each of these samples, shape (samples, 3, 3), m/N."""
        return self._end.compliance

    @property
    def axis(self) -> FloatArray | None:
        """The fingertip's axis at each of these samples, shape (samples, 3); None if it has none."""
        return self._axis if self.geometry.has_axis else None

    @cached_property
    def _straight_part(self) -> list[_Place]:
        return [self._place(p_SK, is_end=False) for p_SK in self.geometry.along_straight_part(_PLACES)]

    def _place(self, p_SK: FloatArray, *, is_end: bool) -> _Place:
        p_PK, J = self.geometry.chain.point_jacobians(self._q, p_SK)
        return _Place(p_SK, p_PK, self._compliances(J), is_end)

    def touches(
        self,
        grid: DistanceGrid,
        X_PO: FloatArray,
        generator: np.random.Generator,
        count: int,
        refused: Counter[str] | None = None,
        *,
        with_sides: bool = False,
    ) -> FingerTouches:
        """Finds up to `count` touches, in ascending order of cost.

        Args:
            grid: the object's signed distance.
            X_PO: the object's pose, shape (3, 4).
            generator: chooses among the samples near the surface.
            count: the largest number wanted.
            refused: counts the reasons for which touches were rejected.
            with_sides: whether the fingertip may also touch with its straight part, besides its round end.
        """
        surface = PlacedGrid(grid, X_PO)
        places = [self._end, *self._straight_part] if with_sides else [self._end]
        found = [self._touches_at(place, surface, generator, 6 * count, refused) for place in places]
        touches = FingerTouches.joined(found)
        return touches.take(np.argsort(touches.cost, kind="stable")[:count])

    def waiting(self, grid: DistanceGrid, X_PO: FloatArray, clearance: float) -> FloatArray:
        """Joint positions at which the whole finger is off the object, farthest first, shape (n, m), rad or m.

        Args:
            grid: the object's signed distance.
            X_PO: its pose, shape (3, 4).
            clearance: least distance, m.
        """
        q = self._q[:: max(1, len(self._q) // _WAITING)]
        spheres, radius = self.geometry.all_spheres(q)
        distance = (PlacedGrid(grid, X_PO).distance(spheres) - radius).min(axis=1)
        order = np.argsort(-distance, kind="stable")
        waiting: FloatArray = q[order[distance[order] > clearance]]
        return waiting

    def _touches_at(
        self,
        place: _Place,
        surface: PlacedGrid,
        generator: np.random.Generator,
        most: int,
        refused: Counter[str] | None,
    ) -> FingerTouches:
        """Touches with one place of the fingertip, from at most `most` samples."""
        params, radius = self._params, self.geometry.tip_radius
        reaches = np.abs(surface.distance(place.p_PK) - radius) < 0.006
        near = _that_pass({"the fingertip does not reach the surface": reaches}, refused)
        _, normal = surface.distance_and_normal(place.p_PK[near])
        aligned = alignment(place.compliance[near], normal)
        wanted = {"pressing moves the fingertip another way": aligned > params.least_alignment}
        if place.is_end and self.geometry.has_axis:
            facing = np.einsum("ni,ni->n", self._axis[near], -normal)
            wanted["the finger would touch with its side or back"] = facing > params.least_facing - 0.2
        index = near[_that_pass(wanted, refused)]
        if len(index) > most:
            index = generator.choice(index, most, replace=False)
        return self._refine(place, surface, self._q[index], refused)

    def _compliances(self, J: FloatArray) -> FloatArray:
        """Compliances of the fingertip, shape (n, 3, 3), m/N, from its Jacobians (n, 3, m)."""
        weighted = J * self._arms
        compliance: FloatArray = weighted @ np.swapaxes(weighted, 1, 2) / self._params.stiffness
        return compliance

    def _onto_surface(self, place: _Place, surface: PlacedGrid, q: FloatArray) -> FloatArray:
        """Newton steps of joint positions (n, m) that put the place on the surface, within the joint limits."""
        geometry = self.geometry
        for _ in range(self._params.steps):
            p_PT, J = geometry.chain.point_jacobians(q, place.p_SK)
            distance, normal = surface.distance_and_normal(p_PT)
            row = np.einsum("ni,nim->nm", normal, J) * self._arms
            gain = (geometry.tip_radius - distance) / np.sum(row * row, axis=1)
            q = np.clip(q + gain[:, None] * row * self._arms, self._lower, self._upper)
        return q

    def _refine(self, place: _Place, surface: PlacedGrid, q: FloatArray, refused: Counter[str] | None) -> FingerTouches:
        """Puts the place on the surface, and keeps clean touches."""
        geometry, params, chain = self.geometry, self._params, self.geometry.chain
        q = self._onto_surface(place, surface, q)
        p_PT, J = chain.point_jacobians(q, place.p_SK)
        distance, normal = surface.distance_and_normal(p_PT)
        compliance = self._compliances(J)
        aligned = alignment(compliance, normal)
        facing, least_facing = np.full(len(q), _BEST_FACING), params.least_facing
        if not place.is_end:
            axis = chain.sensor_poses(q)[:, :, :3] @ _unit(geometry.p_ST - place.p_SK)
            facing, least_facing = np.einsum("ni,ni->n", axis, -normal), -_BEHIND
        elif geometry.has_axis:
            facing = np.einsum("ni,ni->n", _unit(p_PT - geometry.tip(q, 0.0)), -normal)
        closing = -np.einsum("nim,ni->nm", J, normal) / params.stiffness * self._arms**2
        lift = params.lift / np.einsum("ni,nij,nj->n", normal, compliance, normal)
        q_open = np.clip(q - lift[:, None] * closing, chain.lower, chain.upper)
        p_PC = p_PT - geometry.tip_radius * normal
        opened = surface.distance(geometry.fixed_points(q_open, place.p_SK[None])[:, 0])
        clean = {
            "a joint limit keeps the fingertip off": np.abs(distance - geometry.tip_radius) < params.contact_tolerance,
            "pressing moves the fingertip another way": aligned > params.least_alignment,
            "the finger would touch with its side or back": facing > least_facing,
            "the finger would touch with its very end": facing < params.most_facing,
            "the fingertip would touch an edge or a corner": self._is_open(surface, p_PT, normal)
            & self._is_smooth(surface, p_PC, normal),
            "the finger cannot open so far": opened > geometry.tip_radius + 0.4 * params.lift,
            "the finger behind the fingertip would touch": self._is_clear(place, surface, q, q_open),
        }
        # A fingertip touches best with its shoulder, rather than with its very end or its side.
        cost = 6.0 * (1.0 - aligned) + 2.0 * np.abs(facing - _BEST_FACING)
        touches = FingerTouches(q, closing, q_open, p_PC, normal, cost)
        return touches.take(_that_pass(clean, refused))

    def _is_clear(self, place: _Place, surface: PlacedGrid, q: FloatArray, q_open: FloatArray) -> NDArray[np.bool_]:
        """Whether the finger beside the place is off the object, closed at q and on its way to q_open, shape (n,)."""
        geometry, params = self.geometry, self._params
        clear = np.ones(len(q), dtype=np.bool_)
        if not place.is_end:
            # The straight part may lie along the object, but must not be deeper in it elsewhere.
            tip = np.concatenate([geometry.along_straight_part(_PLACES), geometry.p_ST[None]])
            for posture in (q, q_open):
                beside = surface.distance(geometry.fixed_points(posture, tip))
                clear &= np.all(beside > geometry.tip_radius - _DEEPER, axis=1)
        elif geometry.has_axis:
            side = surface.distance(np.stack([geometry.tip(q, 0.0), geometry.tip(q, 0.5)], axis=1))
            clear &= np.all(side > geometry.tip_radius + 0.0005, axis=1)
        for share in np.linspace(0.0, 1.0, params.approach_stops):
            distance = surface.distance(geometry.spheres(q + share * (q_open - q)))
            clear &= np.all(distance > geometry.radius + params.clearance, axis=1)
        return clear

    def _is_open(self, surface: PlacedGrid, p_PT: FloatArray, normal: FloatArray) -> NDArray[np.bool_]:
        """Whether fingertips at p_PT touch a single place, shape (n,)."""
        params = self._params
        outside = surface.distance(p_PT + params.outwards * normal)
        return np.asarray(outside > self.geometry.tip_radius + params.least_openness * params.outwards)

    def _is_smooth(self, surface: PlacedGrid, p_PC: FloatArray, normal: FloatArray) -> NDArray[np.bool_]:
        """Whether the object has no edge at points p_PC of its surface, shape (n,)."""
        t1, t2 = axes_across(normal)
        beside = p_PC[:, None] + self._params.sideways * np.stack([t1, -t1, t2, -t2], axis=1)
        _, normals = surface.distance_and_normal(beside)
        return np.asarray(np.einsum("nki,ni->nk", normals, normal).min(axis=1) > np.cos(self._params.most_turn))


def _that_pass(wanted: Mapping[str, NDArray[np.bool_]], refused: Counter[str] | None) -> NDArray[np.intp]:
    """Indices of those of n touches that fulfil all conditions; for the others, the first one violated is counted."""
    passed = np.ones(len(next(iter(wanted.values()))), dtype=np.bool_)
    for reason, good in wanted.items():
        if refused is not None:
            refused[reason] += int(np.count_nonzero(passed & ~good))
        passed &= good
    return np.flatnonzero(passed)


def alignment(compliance: FloatArray, normal: FloatArray) -> FloatArray:
    """Cosine between the normal and the motion that a push along it causes, shape (n,); 0 if it causes none."""
    motion = np.einsum("nij,nj->ni", compliance, normal)
    moved = np.maximum(np.linalg.norm(motion, axis=1), 1e-12)
    cosine: FloatArray = np.einsum("ni,ni->n", motion, normal) / moved
    return cosine


def _unit(v: FloatArray) -> FloatArray:
    unit: FloatArray = v / np.maximum(np.linalg.norm(v, axis=-1, keepdims=True), 1e-12)
    return unit
