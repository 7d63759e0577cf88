"""What the tracker is told: a frame of what is sensed at one time, contacts and maybe a pose from vision."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from tactopose_drake.core.compilation import read_only
from tactopose_drake.core.evidence.evidence import Evidence
from tactopose_drake.core.evidence.gaussian_prior import GaussianPrior
from tactopose_drake.core.geometry_checks import pose_matrix, pose_near
from tactopose_drake.core.kernels.matrix_kernels import eigenpairs
from tactopose_drake.core.plain_values import copied, numbers
from tactopose_drake.core.posterior.moved_origin import move_origin, prior_of_middle
from tactopose_drake.core.validation import LATEST, FloatArray, instance_of, limited
from tactopose_drake.errors import InvalidInputError

FASTEST = 1e4  # of a fingertip, rad/s and m/s: beyond it is none
_LEAST_SIGMA, _MOST_VARIANCE = 1e-7, 1e12
_W, _V = slice(0, 3), slice(3, 6)
_ANY_PRIOR = GaussianPrior(np.eye(3, 4))


@dataclasses.dataclass(frozen=True, eq=False)
class PoseMeasurement:
    """The object's pose in the palm at one time in the past.

    Attributes:
        time: when it was so, s, of the clock that the frames of the belief are of: of the picture, not of its delivery.
        X_PO: the pose at that time, shape (3, 4), p in m, up to 10; a RigidTransform is taken too.
        covariance: of the increment (w, v) from it to the true pose, shape (6, 6), rad and m, of standard
            deviations from 1e-7 to 1e6.

    Raises:
        InvalidInputError: a time or pose that is none, or a covariance that is not symmetric and positive definite.
    """

    time: float
    X_PO: FloatArray
    covariance: FloatArray

    def __post_init__(self) -> None:
        object.__setattr__(self, "time", float(limited("time", self.time, (), most=LATEST)))
        covariance = limited("covariance", self.covariance, (6, 6), most=_MOST_VARIANCE)
        scale = np.sqrt(np.abs(np.diag(covariance)))
        if np.any(np.abs(covariance - covariance.T) > 1e-6 * np.outer(scale, scale)):
            raise InvalidInputError("covariance: is not symmetric.")
        if scale.min() < _LEAST_SIGMA or np.linalg.eigvalsh(covariance / np.outer(scale, scale)).min() <= 0.0:
            raise InvalidInputError(
                f"covariance: is not positive definite with standard deviations of {_LEAST_SIGMA:g} or more."
            )
        X_PO = pose_near("X_PO", self.X_PO)
        for name, array in (("X_PO", X_PO), ("covariance", covariance)):
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    def __repr__(self) -> str:
        return f"<PoseMeasurement at {self.time:.3f} s: p_PO {numbers(1e3 * self.X_PO[:, 3], 1)} mm>"

    @classmethod
    def from_prior(cls, prior: GaussianPrior, time: float) -> PoseMeasurement:
        """What a prior says.

        Args:
            prior: of the pose.
            time: when it is so, s.
        """
        return cls(time, prior.mean, np.diag(prior.sigmas**2))

    def moved_to(self, time: float, X_PO: FloatArray, covariance: FloatArray) -> PoseMeasurement:
        """The same as of another time: what is computed of a pose that was checked is not checked again.

        Args:
            time: s.
            X_PO: the pose then, shape (3, 4).
            covariance: of the increment (w, v) from it, shape (6, 6), rad and m.
        """
        return copied(self, time=time, X_PO=X_PO, covariance=covariance)

    def is_news_after(self, last: PoseMeasurement) -> bool:
        """Whether it says more than the last one did: another pose, or the same more surely.

        One that is less sure of the same pose may be of a filter that sees nothing any more.
        """
        is_same = np.array_equal(self.X_PO, last.X_PO)
        return not is_same or bool(np.any(np.diag(self.covariance) < np.diag(last.covariance)))

    def as_prior(self) -> GaussianPrior:
        """A prior that is at least as wide in every direction of rotation and of translation."""
        parts = np.stack([self.covariance[part, part] for part in (_W, _V)])
        rotation, translation = np.sqrt(eigenpairs(parts)[0].max(axis=1)).tolist()
        mean = read_only(self.X_PO)
        return copied(_ANY_PRIOR, mean=mean, sigma_rotation=rotation, sigma_translation=translation)


@dataclasses.dataclass(frozen=True, eq=False)
class Frame:
    """What is sensed at one time.

    Attributes:
        time: s.
        evidence: the touch, and what else is known at this time. A prior in it starts a belief that has no pose yet.
        sources: what made each row of `evidence.touch` (a finger, a pad), as the same contact is known by at other
            times; by default the rows' numbers. All that ever were are remembered: of a hundred a step takes long.
        tip_velocity: spatial velocity of each source in P, by source, shape (6,): [w, v], rad/s, and m/s of its point
            at the origin of P. None where fingers are not known to move: the object then moves with the palm.
        vision: the latest pose from vision, however late; None where there is none.
        X_WP: pose of the palm in the world, shape (3, 4), where an object rests that nothing touches; None where it is
            not known: that object then stays where it is in the palm, about.
        depth_in_hand: how deep the object would reach into the hand at poses (n, 3, 4), shape (n,), m: more exactly
            than the evidence knows it, and slower; None where that is not asked.

    Raises:
        InvalidInputError: sources that are not as many as the contacts, or twice the same; a velocity of another shape.
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
            raise InvalidInputError(
                f"sources: are {sources}; allowed are {count} different names, one for each contact."
            )
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
        """The sources, which are there once the frame is made."""
        assert self.sources is not None
        return self.sources

    def of_middle(self, p_OC: FloatArray) -> Frame:
        """The same of the pose of C, which is at p_OC, shape (3,), m, with O's axes, in place of that of O.

        The spreads of a prior and of vision are taken for those of the object's middle.
        """
        evidence, vision, depth = self.evidence, self.vision, self.depth_in_hand
        if evidence.prior is not None:
            evidence = copied(evidence, prior=prior_of_middle(evidence.prior, p_OC))
        if vision is not None:
            vision = vision.moved_to(vision.time, move_origin(vision.X_PO, p_OC), vision.covariance)

        def depth_of_middle(X_PC: FloatArray) -> FloatArray:
            assert depth is not None
            return depth(move_origin(X_PC, -p_OC))

        return copied(self, evidence=evidence, vision=vision, depth_in_hand=None if depth is None else depth_of_middle)
