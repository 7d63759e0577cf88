"""Guarded motions of a fingertip, which end where it meets the object, and their outcomes."""

import dataclasses
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactopose_drake.core.compilation import read_only
from tactopose_drake.core.evidence.hand_geometry import HandGeometry
from tactopose_drake.core.exploration import guarded_kernels
from tactopose_drake.core.geometry_checks import unit_vectors
from tactopose_drake.core.grasping.finger_geometry import FingerGeometry
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import FloatArray, finite_array, positive_number
from tactopose_drake.errors import InvalidInputError


@dataclasses.dataclass(frozen=True, eq=False)
class GuardedMoves:
    """Guarded motions of one finger, m of them, in the palm frame, each as a sequence of s stops.

    Attributes:
        tip: centres of the fingertip's round end, shape (m, s, 3), m; spaced less than the object's thickness.
        radius: of the round end, m; 0 for a needle.
        body: centres of spheres that fill the rest of the finger, shape (m, s, b, 3), m.
        body_radius: their radii, shape (b,), m.

    Raises:
        InvalidInputError: a shape that does not fit, fewer than two places, or a number that is not finite.
    """

    tip: FloatArray
    radius: float
    body: FloatArray
    body_radius: FloatArray

    def __post_init__(self) -> None:
        tip = finite_array("tip", self.tip, (None, None, 3))
        if tip.shape[1] < 2:
            raise InvalidInputError(f"tip must have at least 2 places along each motion, not {tip.shape[1]}.")
        body_radius = finite_array("body_radius", self.body_radius, (None,))
        body = finite_array("body", self.body, (*tip.shape[:2], len(body_radius), 3))
        radius = positive_number("radius", self.radius, allow_zero=True)
        for name, value in (("tip", tip), ("radius", radius), ("body", body), ("body_radius", body_radius)):
            object.__setattr__(self, name, value)

    def __len__(self) -> int:
        return len(self.tip)

    @property
    def _finger(self) -> guarded_kernels.Finger:
        """The motions in the form that kernels read."""
        return guarded_kernels.Finger(
            read_only(self.tip), self.radius, read_only(self.body), read_only(self.body_radius)
        )

    @classmethod
    def lines(
        cls, start: ArrayLike, direction: ArrayLike, length: float, *, radius: float = 0.0, step: float = 0.001
    ) -> Self:
        """Straight motions of a fingertip alone.

        Args:
            start: start of its centre, shape (m, 3), m.
            direction: unit vectors, shape (m, 3).
            length: of the motion, m.
            radius: of the fingertip, m; 0 for a ray.
            step: largest distance between stops, m.
        """
        start = finite_array("start", start, (None, 3))
        direction = unit_vectors("direction", direction, (len(start), 3))
        places = max(2, 1 + int(np.ceil(positive_number("length", length) / positive_number("step", step))))
        way = np.linspace(0.0, length, places)[:, None] * direction[:, None]
        return cls(start[:, None] + way, radius, np.zeros((len(start), places, 0, 3)), np.zeros(0))

    @classmethod
    def of_finger(cls, finger: FingerGeometry, q_start: FloatArray, q_goal: FloatArray, places: int = 40) -> Self:
        """Motions of a finger that are straight in joint space.

        Args:
            finger: the finger.
            q_start: start joint positions, shape (n,) or (m, n), rad.
            q_goal: goal joint positions, shape (m, n), rad.
            places: number of stops of each.
        """
        share = np.linspace(0.0, 1.0, places)[:, None]
        q = np.broadcast_to(q_start, q_goal.shape)[:, None] * (1.0 - share) + share * q_goal[:, None]
        rows = q.reshape(-1, q_goal.shape[1])
        centres, radius = finger.all_spheres(rows)
        return cls(
            centres[:, -1].reshape(len(q_goal), places, 3),
            finger.tip_radius,
            centres[:, :-1].reshape(len(q_goal), places, -1, 3),
            radius[:-1],
        )

    def take(self, index: NDArray[np.intp]) -> Self:
        """A subset of the motions."""
        return dataclasses.replace(self, tip=self.tip[index], body=self.body[index])

    def feel(self, model: ObjectModel, X_PO: FloatArray) -> "Felt":
        """The outcome of each motion for each of B poses (B, 3, 4) of the object."""
        grid, places = model.grid, self.tip.shape[1]
        place, before, after = np.empty((len(X_PO), len(self)), dtype=np.intp), *np.ones((2, len(X_PO), len(self)))
        guarded_kernels.first_hits(grid.nodes, self.tip, self.radius, X_PO, place, before, after)
        steps = np.diff(self.tip, axis=1)
        lengths = np.linalg.norm(steps, axis=2)
        travelled = np.concatenate([np.zeros((len(self), 1)), np.cumsum(lengths, axis=1)], axis=1)
        row, at = np.arange(len(self)), np.minimum(place, places - 1) - 1
        share = np.clip(before / np.maximum(before - after, 1e-12), 0.0, 1.0)
        step, p_PT = steps[row, at], self.tip[row, at] + share[..., None] * steps[row, at]
        R_PO = X_PO[:, :, :3]
        distance, n_O = grid.distance_and_normal(np.einsum("bmi,bij->bmj", p_PT - X_PO[:, None, :, 3], R_PO))
        n_PC = np.einsum("bij,bmj->bmi", R_PO, n_O)
        heading = step / np.maximum(lengths[row, at], 1e-12)[..., None]
        return Felt(
            place < places,
            travelled[row, at] + share * lengths[row, at],
            p_PT - distance[..., None] * n_PC,
            n_PC,
            -np.einsum("bmi,bmi->bm", heading, n_PC),
        )

    def stay_apart(self, others: HandGeometry, model: ObjectModel, X_PO: FloatArray) -> NDArray[np.bool_]:
        """Which motions (m,) keep the finger off the rest of the hand, up to the latest hit over poses (B, 3, 4).

        Parts that overlap the rest of the hand where a motion starts are ignored, as they are joined to it.
        """
        grid, places = model.grid, self.tip.shape[1]
        place, gaps = np.empty((len(X_PO), len(self)), dtype=np.intp), np.empty((2, len(X_PO), len(self)))
        guarded_kernels.first_hits(grid.nodes, self.tip, self.radius, X_PO, place, gaps[0], gaps[1])
        end, apart = np.minimum(place.max(axis=0), places - 1), np.empty(len(self), dtype=np.bool_)
        guarded_kernels.stay_apart(self._finger, others.p_PH, others.radius, end, apart)
        return apart

    def are_clear(self, model: ObjectModel, X_PO: FloatArray) -> NDArray[np.bool_]:
        """Whether each motion starts off the object and meets it with the fingertip first, shape (B, m), at (B, 3, 4).

        What follows the fingertip's contact does not count, as the motion ends there.
        """
        grid, clear = model.grid, np.empty((len(X_PO), len(self)), dtype=np.bool_)
        guarded_kernels.are_clear(
            grid.nodes,
            self._finger,
            X_PO,
            clear,
        )
        return clear


class Felt(NamedTuple):
    """The outcomes of m motions at B poses.

    Attributes:
        is_hit: whether they meet the object, shape (B, m); the other fields are valid only then.
        way: distance travelled by the fingertip's centre, shape (B, m), m.
        p_PC: the points of contact, shape (B, m, 3), m.
        n_PC: outward normals of the object there, shape (B, m, 3).
        facing: cosine between the fingertip's direction of motion and the inward normal, shape (B, m).
    """

    is_hit: NDArray[np.bool_]
    way: FloatArray
    p_PC: FloatArray
    n_PC: FloatArray
    facing: FloatArray
