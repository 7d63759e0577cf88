"""Where one finger can touch an object that is in a given pose in the palm."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field, fields

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core import poses
from tactopose_drake.core.grasping.serial_chain import SerialChain
from tactopose_drake.core.shape.signed_distance import DistanceGrid
from tactopose_drake.core.validation import FloatArray, positive_number

# The cosine between a finger's axis and the direction to the contact that is best: at the fingertip's shoulder.
_BEST_FACING = 0.6


@dataclass(frozen=True, eq=False)
class FingerGeometry:
    """A finger's kinematics and shape.

    Attributes:
        chain: kinematics from palm to sensor.
        p_ST: centre of the fingertip's round end in the sensor's frame, shape (3,), m.
        tip_radius: m.
        body: which body of the chain each sphere is fixed on, shape (s,).
        p_BH: centres of spheres that fill the finger without its tip, in their bodies, shape (s, 3), m.
        radius: their radii, shape (s,), m.
        p_SR: root of the fingertip's axis, which ends in p_ST, in the sensor's frame, shape (3,), m; p_ST itself where
            the fingertip has no axis and may touch with any of its sides.
    """

    chain: SerialChain
    p_ST: FloatArray
    tip_radius: float
    body: NDArray[np.intp]
    p_BH: FloatArray
    radius: FloatArray
    p_SR: FloatArray = field(default_factory=lambda: np.zeros(3))

    @property
    def has_axis(self) -> bool:
        """Whether the fingertip has an axis."""
        return bool(np.any(self.p_ST != self.p_SR))

    def spheres(self, q: FloatArray) -> FloatArray:
        """Centres in P, shape (B, s, 3), for positions q (B, m), rad."""
        X_PB = self.chain.body_poses(q)[:, self.body]
        centres: FloatArray = np.einsum("bsij,sj->bsi", X_PB[..., :3], self.p_BH) + X_PB[..., 3]
        return centres

    def axis(self, q: FloatArray) -> FloatArray:
        """Points in P on the finger's axis from its last two joints to the round end's centre, (B, 4, 3) or less."""
        on_links = self.chain.body_poses(q)[:, -2:, :, 3]
        return np.concatenate([on_links, self.tip(q, 0.0)[:, None], self.tip(q)[:, None]], axis=1)

    def tip(self, q: FloatArray, height: float = 1.0) -> FloatArray:
        """Points in P on the line from the root of the axis (height 0) to the round end's centre (1), shape (B, 3)."""
        p_SQ = self.p_SR + height * (self.p_ST - self.p_SR)
        return poses.transform_points(self.chain.sensor_poses(q), p_SQ[None])[:, 0]


@dataclass(frozen=True, eq=False)
class Touches:
    """Ways for one finger to touch; n of them.

    Attributes:
        q: joint positions in contact, shape (n, m), rad.
        closing: change of joint command that presses with 1 N along the object's normal, shape (n, m), rad/N.
        q_open: joint positions with the finger lifted off, shape (n, m), rad.
        p_PC: contact points, shape (n, 3), m.
        n_PC: the object's outward normals, shape (n, 3).
        cost: how far each is from a clean touch, shape (n,); 0 is best.
    """

    q: FloatArray
    closing: FloatArray
    q_open: FloatArray
    p_PC: FloatArray
    n_PC: FloatArray
    cost: FloatArray

    def __len__(self) -> int:
        return len(self.q)

    def take(self, index: NDArray[np.intp]) -> "Touches":
        """Some of them."""
        return Touches(*(getattr(self, name)[index] for name in Touches.__dataclass_fields__))


@dataclass(kw_only=True, slots=True)
class ReachParams:
    """What counts as a clean touch."""

    stiffness: float = 5.0  # of each joint under the grasp controller, N m/rad; a radian is 5 cm of a sliding joint
    lift: float = 0.015  # distance of the open fingertip from the object, m
    clearance: float = 0.002  # least distance of the rest of the finger from the object, m
    least_alignment: float = 0.75  # cosine between the normal and the way the closing fingertip goes
    least_facing: float = 0.12  # cosine between the finger's axis and the direction to the contact: 0 at its side
    most_facing: float = 0.97  # 1 at its very end
    limit_margin: float = 0.03  # distance from the joint limits in contact, rad; a radian is 5 cm of a sliding joint
    steps: int = 4  # of the search for exact contact
    contact_tolerance: float = 1e-4  # distance of the fingertip from the surface after them, m
    approach_stops: int = 3  # on the way from closed to open, both included, at which the finger must be clear
    # What a touch's surroundings must be like: a little further out, m, the distance grows by so much of the way.
    outwards: float = 0.003
    least_openness: float = 0.8  # share of the way: less is where the fingertip sits in a corner and touches two places
    # A little to the side, the normal turns less than this: it turns more on an edge rounded by less than 4 mm.
    sideways: float = 0.002  # m
    most_turn: float = 0.5  # rad

    def validate(self) -> None:
        """Raises InvalidInputError if a value is not positive."""
        for parameter in fields(self):
            positive_number(f"ReachParams.{parameter.name}", getattr(self, parameter.name))


class FingerReach:
    """Samples of a finger's workspace, made once; asked for touches on any object in any pose."""

    def __init__(
        self, geometry: FingerGeometry, params: ReachParams, generator: np.random.Generator, samples: int = 3000
    ) -> None:
        """Samples the workspace.

        Args:
            geometry: the finger.
            params: see there.
            generator: source of the samples.
            samples: how many joint positions.
        """
        chain = geometry.chain
        self.geometry, self._params, self._arms = geometry, params, chain.arms
        margin = np.minimum(params.limit_margin * self._arms, 0.45 * (chain.upper - chain.lower))
        self._lower, self._upper = chain.lower + margin, chain.upper - margin
        self._q = generator.uniform(self._lower, self._upper, (samples, len(margin)))
        self._p_PT, J = chain.point_jacobians(self._q, geometry.p_ST)
        self._axis = chain.sensor_poses(self._q)[:, :, :3] @ _unit(geometry.p_ST - geometry.p_SR)
        self._compliance = self._compliances(J)

    @property
    def reached(self) -> FloatArray:
        """Samples of where the fingertip's round end can be, in P, shape (samples, 3), m."""
        return self._p_PT

    def touches(
        self,
        grid: DistanceGrid,
        X_PO: FloatArray,
        generator: np.random.Generator,
        count: int,
        refused: Counter[str] | None = None,
    ) -> Touches:
        """Up to `count` touches, by rising cost.

        Args:
            grid: the object's signed distance.
            X_PO: the object's pose, shape (3, 4).
            generator: chooses among the samples near the surface.
            count: the largest number wanted.
            refused: what is wrong with the touches that are not taken is counted there.
        """
        params, radius = self._params, self.geometry.tip_radius
        distance, normal = _distance(grid, X_PO, self._p_PT)
        alignment = _alignment(self._compliance, normal)
        wanted = {
            "the fingertip does not reach the surface": np.abs(distance - radius) < 0.006,
            "pressing moves the fingertip another way": alignment > params.least_alignment,
        }
        if self.geometry.has_axis:
            facing = np.einsum("ni,ni->n", self._axis, -normal)
            wanted["the finger would touch with its side or back"] = facing > params.least_facing - 0.2
        index = _that_pass(wanted, refused)
        if len(index) > 6 * count:
            index = generator.choice(index, 6 * count, replace=False)
        touches = self._refine(grid, X_PO, self._q[index], refused)
        return touches.take(np.argsort(touches.cost, kind="stable")[:count])

    def _compliances(self, J: FloatArray) -> FloatArray:
        """How far the fingertip gives way to forces, shape (n, 3, 3), m/N, from its Jacobians (n, 3, m)."""
        weighted = J * self._arms
        compliance: FloatArray = weighted @ np.swapaxes(weighted, 1, 2) / self._params.stiffness
        return compliance

    def _onto_surface(self, grid: DistanceGrid, X_PO: FloatArray, q: FloatArray) -> FloatArray:
        """The joint positions (n, m), moved so that the fingertip is on the surface where it can be."""
        geometry = self.geometry
        for _ in range(self._params.steps):
            p_PT, J = geometry.chain.point_jacobians(q, geometry.p_ST)
            distance, normal = _distance(grid, X_PO, p_PT)
            row = np.einsum("ni,nim->nm", normal, J) * self._arms
            gain = (geometry.tip_radius - distance) / np.sum(row * row, axis=1)
            q = np.clip(q + gain[:, None] * row * self._arms, self._lower, self._upper)
        return q

    def _refine(self, grid: DistanceGrid, X_PO: FloatArray, q: FloatArray, refused: Counter[str] | None) -> Touches:
        """Moves the fingertip onto the surface, and keeps what is clean."""
        geometry, params, chain = self.geometry, self._params, self.geometry.chain
        q = self._onto_surface(grid, X_PO, q)
        p_PT, J = chain.point_jacobians(q, geometry.p_ST)
        distance, normal = _distance(grid, X_PO, p_PT)
        compliance = self._compliances(J)
        alignment = _alignment(compliance, normal)
        facing = np.full(len(q), _BEST_FACING)
        if geometry.has_axis:
            facing = np.einsum("ni,ni->n", _unit(p_PT - geometry.tip(q, 0.0)), -normal)
        closing = -np.einsum("nim,ni->nm", J, normal) / params.stiffness * self._arms**2
        lift = params.lift / np.einsum("ni,nij,nj->n", normal, compliance, normal)
        q_open = np.clip(q - lift[:, None] * closing, chain.lower, chain.upper)
        p_PC = p_PT - geometry.tip_radius * normal
        opened = _distance(grid, X_PO, geometry.tip(q_open))[0]
        clean = {
            "a joint limit keeps the fingertip off": np.abs(distance - geometry.tip_radius) < params.contact_tolerance,
            "pressing moves the fingertip another way": alignment > params.least_alignment,
            "the finger would touch with its side or back": facing > params.least_facing,
            "the finger would touch with its very end": facing < params.most_facing,
            "the fingertip would touch an edge or a corner": self._is_open(grid, X_PO, p_PT, normal)
            & self._is_smooth(grid, X_PO, p_PC, normal),
            "the finger cannot open so far": opened > geometry.tip_radius + 0.4 * params.lift,
            "the finger behind the fingertip would touch": self._is_clear(grid, X_PO, q, q_open),
        }
        # A fingertip meets best with its shoulder, not with its very end or its side.
        cost = 6.0 * (1.0 - alignment) + 2.0 * np.abs(facing - _BEST_FACING)
        touches = Touches(q, closing, q_open, p_PC, normal, cost)
        return touches.take(_that_pass(clean, refused))

    def _is_clear(self, grid: DistanceGrid, X_PO: FloatArray, q: FloatArray, q_open: FloatArray) -> NDArray[np.bool_]:
        """Whether the finger behind its round end is off the object, closed at q and on its way to q_open, (n,)."""
        geometry, params = self.geometry, self._params
        clear = np.ones(len(q), dtype=np.bool_)
        if geometry.has_axis:
            side, _ = _distance(grid, X_PO, np.stack([geometry.tip(q, 0.0), geometry.tip(q, 0.5)], axis=1))
            clear &= np.all(side > geometry.tip_radius + 0.0005, axis=1)
        for share in np.linspace(0.0, 1.0, params.approach_stops):
            distance, _ = _distance(grid, X_PO, geometry.spheres(q + share * (q_open - q)))
            clear &= np.all(distance > geometry.radius + params.clearance, axis=1)
        return clear

    def _is_open(self, grid: DistanceGrid, X_PO: FloatArray, p_PT: FloatArray, normal: FloatArray) -> NDArray[np.bool_]:
        """Whether fingertips about p_PT touch one place only, shape (n,)."""
        params = self._params
        outside, _ = _distance(grid, X_PO, p_PT + params.outwards * normal)
        return np.asarray(outside > self.geometry.tip_radius + params.least_openness * params.outwards)

    def _is_smooth(
        self, grid: DistanceGrid, X_PO: FloatArray, p_PC: FloatArray, normal: FloatArray
    ) -> NDArray[np.bool_]:
        """Whether the object has no edge at points p_PC of its surface, shape (n,)."""
        t1 = _unit(np.cross(normal, np.eye(3)[np.argmin(np.abs(normal), axis=1)]))
        t2 = np.cross(normal, t1)
        beside = p_PC[:, None] + self._params.sideways * np.stack([t1, -t1, t2, -t2], axis=1)
        _, normals = _distance(grid, X_PO, beside)
        return np.asarray(np.einsum("nki,ni->nk", normals, normal).min(axis=1) > np.cos(self._params.most_turn))


def _that_pass(wanted: Mapping[str, NDArray[np.bool_]], refused: Counter[str] | None) -> NDArray[np.intp]:
    """Which of n touches are all that is wanted; of the others, what is wanting first is counted."""
    passed = np.ones(len(next(iter(wanted.values()))), dtype=np.bool_)
    for reason, good in wanted.items():
        if refused is not None:
            refused[reason] += int(np.count_nonzero(passed & ~good))
        passed &= good
    return np.flatnonzero(passed)


def _distance(grid: DistanceGrid, X_PO: FloatArray, p_PQ: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Signed distances (...) and normals in P (..., 3) of the object at points (..., 3) in P."""
    R_PO = X_PO[:, :3]
    distance, n_O = grid.distance_and_normal((p_PQ - X_PO[:, 3]) @ R_PO)
    return distance, n_O @ R_PO.T


def _alignment(compliance: FloatArray, normal: FloatArray) -> FloatArray:
    """Cosine between the normal and the motion that a push along it causes, shape (n,)."""
    motion = np.einsum("nij,nj->ni", compliance, normal)
    cosine: FloatArray = np.einsum("ni,ni->n", motion, normal) / np.linalg.norm(motion, axis=1)
    return cosine


def _unit(v: FloatArray) -> FloatArray:
    unit: FloatArray = v / np.maximum(np.linalg.norm(v, axis=-1, keepdims=True), 1e-12)
    return unit
