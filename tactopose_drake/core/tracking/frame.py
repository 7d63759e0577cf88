"""The input of the tracker: a frame of what is sensed at one time, contacts and possibly a pose from vision."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from tactopose_drake.core.evidence.evidence import Evidence
from tactopose_drake.core.evidence.gaussian_prior import GaussianPrior
from tactopose_drake.core.geometry_checks import pose_matrix, pose_near
from tactopose_drake.core.kernels.matrix_kernels import eigenpairs
from tactopose_drake.core.plain_values import ReadOnlyCopies, copied, numbers
from tactopose_drake.core.posterior.moved_origin import move_measurement, move_origin, prior_of_middle
from tactopose_drake.core.validation import LATEST, FloatArray, instance_of, limited
from tactopose_drake.errors import InvalidInputError

FASTEST = 1e4  # upper bound on a fingertip's speed, rad/s and m/s
_LEAST_SIGMA, _MOST_VARIANCE = 1e-7, 1e12
_W, _V = slice(0, 3), slice(3, 6)


@dataclasses.dataclass(frozen=True, eq=False)
class PoseMeasurement(ReadOnlyCopies):
    """The object's pose in the palm at one time in the past.

    Attributes:
        time: when the pose was measured, s, on the clock of the belief's frames: of the picture, not of its delivery.
        X_PO: the pose at that time, shape (3, 4), p in m, up to 10; a RigidTransform is taken too.
        covariance: of the increment (w, v) from it to the true pose, shape (6, 6), rad and m, with standard
            deviations from 1e-7 to 1e6. If the object's frame has its origin far away, a covariance without any
            correlation of w and v is taken for that of the object's middle, like a prior's sigmas.

    Raises:
        InvalidInputError: an invalid time or pose, or a covariance that is not symmetric and positive definite.
    """

    time: float
    X_PO: FloatArray
    covariance: FloatArray

    def __post_init__(self) -> None:
        object.__setattr__(self, "time", float(limited("time", self.time, (), most=LATEST)))
        covariance = limited("covariance", self.covariance, (6, 6), most=_MOST_VARIANCE)
        scale = np.sqrt(np.abs(np.diag(covariance)))
        off = np.abs(covariance - covariance.T)
        if np.any(off > 1e-6 * np.outer(scale, scale)):
            raise InvalidInputError(f"covariance must be symmetric, not asymmetric by {off.max():.3g}.")
        if scale.min() < _LEAST_SIGMA:
            raise InvalidInputError(
                f"covariance must have standard deviations of at least {_LEAST_SIGMA:g}, not {scale.min():g}."
            )
        least = np.linalg.eigvalsh(covariance / np.outer(scale, scale)).min()
        if least <= 0.0:
            raise InvalidInputError(
                f"covariance must be positive definite, not of correlations with the eigenvalue {least:.3g}."
            )
        X_PO = pose_near("X_PO", self.X_PO)
        for name, array in (("X_PO", X_PO), ("covariance", covariance)):
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    def __repr__(self) -> str:
        return f"<PoseMeasurement at {self.time:.3f} s: p_PO {numbers(1e3 * self.X_PO[:, 3], 1)} mm>"

    @classmethod
    def from_prior(cls, prior: GaussianPrior, time: float) -> PoseMeasurement:
        """The measurement that is equivalent to a prior.

        Args:
            prior: of the pose.
            time: when it holds, s.
        """
        return cls(time, prior.mean, np.diag(prior.sigmas**2))

    def moved_to(self, time: float, X_PO: FloatArray, covariance: FloatArray) -> PoseMeasurement:
        """The measurement moved to another time, without checking it again.

        Args:
            time: s.
            X_PO: the pose then, shape (3, 4).
            covariance: of the increment (w, v) from it, shape (6, 6), rad and m.
        """
        return copied(self, time=time, X_PO=X_PO, covariance=covariance)

    def is_news_after(self, last: PoseMeasurement) -> bool:
        """Whether it adds to the last measurement: another pose, or the same with less variance.

        The same pose with more variance may come from a filter that no longer sees the object.
        """
        is_same = np.array_equal(self.X_PO, last.X_PO)
        return not is_same or bool(np.any(np.diag(self.covariance) < np.diag(last.covariance)))

    def as_prior(self) -> GaussianPrior:
        """A prior that is at least as wide in every direction of rotation and of translation."""
        parts = np.stack([self.covariance[part, part] for part in (_W, _V)])
        rotation, translation = np.sqrt(eigenpairs(parts)[0].max(axis=1)).tolist()
        return GaussianPrior.unchecked(self.X_PO, translation, rotation)


@dataclasses.dataclass(frozen=True, eq=False)
class Frame:
    """What is sensed at one time.

    Attributes:
        time: s.
        evidence: the touch, and what else is known at this time. A prior in it starts a belief that has no pose yet.
        sources: identifiers of what made each row of `evidence.touch` (a finger, a pad), the same at all times; by
            default the row numbers. All that ever occur are remembered; with a hundred of them a step takes long.
        tip_velocity: spatial velocity of each source in P, by source, shape (6,): [w, v], rad/s, and m/s of its point
            at the origin of P. None if the fingers' motion is unknown: the object then moves with the palm.
        vision: the latest pose from vision, however late; None if there is none.
        X_WP: pose of the palm in the world, in which an object rests that nothing touches, shape (3, 4); None if
            unknown: that object is then assumed to stay roughly where it is in the palm.
        depth_in_hand: maps poses (n, 3, 4) to the depth to which the object would penetrate the hand, shape (n,), m;
            more exact and slower than the evidence's own. None if not available.

    Raises:
        InvalidInputError: sources that are duplicate or not one for each contact; a velocity of wrong shape.
    """

    time: float
    evidence: Evidence
    sources: tuple[str, ...] | None = None
    tip_velocity: Mapping[str, FloatArray] | None = None
    vision: PoseMeasurement | None = None
    X_WP: FloatArray | None = None
    depth_in_hand: Callable[[FloatArray], FloatArray] | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "time", float(limited("time", self.time, (), most=LATEST)))
        instance_of("evidence", self.evidence, Evidence)
        if self.vision is not None:
            instance_of("vision", self.vision, PoseMeasurement)
        if self.sources is not None:
            instance_of("sources", self.sources, Sequence)
        count = len(self.evidence.touch)
        sources = tuple(map(str, range(count) if self.sources is None else self.sources))
        if len(sources) != count or len(set(sources)) < count:
            raise InvalidInputError(f"sources must be {count} different names, one for each contact, not {sources}.")
        object.__setattr__(self, "sources", sources)
        if self.X_WP is not None:
            object.__setattr__(self, "X_WP", pose_matrix("X_WP", self.X_WP))
        if self.tip_velocity is not None:
            instance_of("tip_velocity", self.tip_velocity, Mapping)
            velocities = {
                name: limited(f"tip_velocity[{name}]", velocity, (6,), most=FASTEST)
                for name, velocity in self.tip_velocity.items()
            }
            object.__setattr__(self, "tip_velocity", velocities)

    @property
    def names(self) -> tuple[str, ...]:
        """The sources, which are always set after construction."""
        assert self.sources is not None
        return self.sources

    def of_middle(self, p_OC: FloatArray) -> Frame:
        """The same frame for the pose of C, which is at p_OC, shape (3,), m, with O's axes, instead of that of O.

        The standard deviations of a prior are taken to be those of the object's middle, and so is a covariance of
        vision without any correlation of w and v: an estimate of O's pose has it, as a rotation moves a far origin.
        """
        evidence, vision, depth = self.evidence, self.vision, self.depth_in_hand
        if evidence.prior is not None:
            evidence = copied(evidence, prior=prior_of_middle(evidence.prior, p_OC))
        if vision is not None:
            X_PC, covariance = move_measurement(vision.X_PO, vision.covariance, p_OC)
            is_correlated = vision.covariance[_W, _V].any()
            vision = vision.moved_to(vision.time, X_PC, covariance if is_correlated else vision.covariance)

        def depth_of_middle(X_PC: FloatArray) -> FloatArray:
            assert depth is not None
            return depth(move_origin(X_PC, -p_OC))

        return copied(self, evidence=evidence, vision=vision, depth_in_hand=None if depth is None else depth_of_middle)
