"""The content of a drawing of an estimate, in the palm frame."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Self

import numpy as np
from numpy.typing import NDArray
from pydrake.math import RigidTransform

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.evidence.patch_contacts import tell_normals, with_patches
from tactopose_drake.core.sensing.patches import Patch
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import FloatArray
from tactopose_drake.errors import InvalidInputError
from tactopose_drake.estimation.descriptions import touch_names
from tactopose_drake.estimation.pose_hypothesis import PoseHypothesis
from tactopose_drake.estimation.results import PoseEstimate
from tactopose_drake.visualization import appearance
from tactopose_drake.visualization.appearance import (
    LEAST_ALTERNATIVE,
    LEAST_INLIER_PROBABILITY,
    LONGEST_ARROW,
    MOST_ALTERNATIVES,
    MOST_FREE,
    Look,
)
from tactopose_drake.visualization.body_meshes import Triangles, sphere_triangles


@dataclasses.dataclass(frozen=True, eq=False)
class ShownHypothesis:
    """One pose of the object, as it is drawn.

    Attributes:
        X_PO: the pose.
        probability: its probability among all hypotheses, 0 to 1.
        covariance: (6, 6) of the increment, as `PoseHypothesis.covariance`; None to draw no uncertainty.
        free_directions: increments that the touch does not determine, unit rows (f, 6).
        inlier_probability: probability that each contact, then each patch, is on the object, shape (k,); None if
            unknown.
    """

    X_PO: RigidTransform
    probability: float = 1.0
    covariance: FloatArray | None = None
    free_directions: FloatArray = dataclasses.field(default_factory=lambda: np.zeros((0, 6)))
    inlier_probability: FloatArray | None = None

    @classmethod
    def of(cls, hypothesis: PoseHypothesis) -> Self:
        """The drawable parts of a hypothesis."""
        return cls(
            hypothesis.X_PO,
            hypothesis.probability,
            hypothesis.covariance,
            hypothesis.free_directions,
            hypothesis.inlier_probability if len(hypothesis.inlier_probability) else None,
        )


@dataclasses.dataclass(frozen=True, eq=False, kw_only=True)
class Scene:
    """An object, contacts, and the object's estimated, prior and true poses.

    Attributes:
        model: the object.
        contacts: the contacts, in the palm frame P; those of the patches come last.
        patches: patches of tactile pads; their pressed cells are drawn.
        touched_by: for each contact, the name of the finger or pad that feels it; empty if unknown.
        hypotheses: the estimated poses, the most probable first; empty if there is no estimate.
        prior: prior pose X_PO, if any.
        truth: true pose X_PO, if known.
        hand: the hand's surface in P, if known.
        up_P: direction in P that is up in pictures, shape (3,).
        friction: coefficient of friction of the cones at the contacts; None to draw no cones.
        frames: whether the frames of palm and object are drawn.
    """

    model: ObjectModel
    contacts: Contacts
    patches: tuple[Patch, ...] = ()
    touched_by: tuple[str, ...] = ()
    hypotheses: tuple[ShownHypothesis, ...] = ()
    prior: RigidTransform | None = None
    truth: RigidTransform | None = None
    hand: Triangles | None = None
    up_P: FloatArray = dataclasses.field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))
    friction: float | None = None
    frames: bool = False

    @property
    def estimate(self) -> RigidTransform | None:
        """The most probable pose X_PO, if there is an estimate."""
        return self.hypotheses[0].X_PO if self.hypotheses else None

    @property
    def alternatives(self) -> tuple[ShownHypothesis, ...]:
        """The hypotheses beside the best that are drawn."""
        return worth_drawing(self.hypotheses)[1:]

    @property
    def is_false(self) -> NDArray[np.bool_]:
        """Which contacts are probably not on the object, by the most probable hypothesis, shape (k,)."""
        return false_contacts(self.hypotheses, len(self.contacts), self.patches)

    @property
    def largest_force(self) -> float:
        """The force of the longest arrow, N; 0 without arrows."""
        return float(shown_forces(self.contacts, self.is_false).max(initial=0.0))

    @property
    def looks(self) -> list[Look]:
        """The parts of the scene that are visible, for its legend."""
        best = self.hypotheses[0] if self.hypotheses else None
        contacts, is_false = self.contacts, self.is_false
        has_normals = bool(tell_normals(contacts).any())
        seen = {
            appearance.ESTIMATE: best is not None,
            appearance.ALTERNATIVE: len(self.alternatives) > 0,
            appearance.UNCERTAINTY: best is not None and best.covariance is not None,
            appearance.FREE: best is not None and 0 < len(best.free_directions) <= MOST_FREE,
            appearance.PRIOR: self.prior is not None,
            appearance.TRUTH: self.truth is not None,
            appearance.CONTACT: bool(np.any(~is_false)),
            appearance.FALSE_CONTACT: bool(np.any(is_false)),
            appearance.NORMAL: has_normals,
            appearance.FORCE: self.largest_force > 0.0,
            appearance.PRESSURE: any(patch.is_felt for patch in self.patches),
            appearance.PATCH_AXES: any(np.isfinite(patch.eigenvectors).any() for patch in self.patches),
            appearance.CONE: self.friction is not None and has_normals,
            appearance.FRAMES: self.frames,
            appearance.HAND: self.hand is not None,
        }
        return [look for look, is_seen in seen.items() if is_seen]


def scene_of(estimate: PoseEstimate) -> Scene:
    """The scene of an estimate and the inputs it was made from.

    Raises:
        InvalidInputError: if the estimate does not hold its inputs.
    """
    if estimate.question is None:
        raise InvalidInputError(
            "estimate must hold the inputs it was made from: one that `estimate_pose` has made in this process, or a "
            "`visualization.Scene`."
        )
    evidence = estimate.question.evidence
    prior, hand, patches = evidence.prior, evidence.hand, tuple(evidence.patches)
    return Scene(
        model=estimate.question.model,
        contacts=touch_of(evidence.contacts, patches),
        patches=patches,
        touched_by=touch_names(len(evidence.contacts), patches),
        hypotheses=tuple(ShownHypothesis.of(hypothesis) for hypothesis in estimate.hypotheses),
        prior=None if prior is None else RigidTransform(prior.mean),
        hand=None if hand is None or not len(hand.radius) else sphere_triangles(hand.p_PH, hand.radius),
    )


def worth_drawing(hypotheses: Sequence[ShownHypothesis]) -> tuple[ShownHypothesis, ...]:
    """The first hypothesis, and the next ones that are probable enough; given in order of falling probability."""
    others = hypotheses[1 : 1 + MOST_ALTERNATIVES]
    return (*hypotheses[:1], *(other for other in others if other.probability >= LEAST_ALTERNATIVE))


def inlier_probabilities(
    hypotheses: tuple[ShownHypothesis, ...], count: int, patches: Sequence[Patch] = ()
) -> FloatArray | None:
    """Probability that each of `count` contacts is on the object, by the first hypothesis, shape (count,).

    The last contacts may be those of the pressed patches, as by `touch_of`; the hypothesis's inlier probabilities end
    with those of all patches. None if the hypothesis has none, or is of an earlier touch with fewer contacts.
    """
    inlier = hypotheses[0].inlier_probability if hypotheses else None
    if inlier is not None and len(inlier) >= len(patches):
        silent = [i - len(patches) for i, patch in enumerate(patches) if not patch.is_felt]
        inlier = np.delete(inlier, silent)
    return None if inlier is None or len(inlier) < count else np.asarray(inlier)[:count]


def false_contacts(
    hypotheses: tuple[ShownHypothesis, ...], count: int, patches: Sequence[Patch] = ()
) -> NDArray[np.bool_]:
    """Which of `count` contacts are probably not on the object, shape (count,); arguments as `inlier_probabilities`."""
    inlier = inlier_probabilities(hypotheses, count, patches)
    return np.zeros(count, dtype=np.bool_) if inlier is None else inlier < LEAST_INLIER_PROBABILITY


def touch_of(contacts: Contacts, patches: Sequence[Patch]) -> Contacts:
    """The contacts, followed by the centroids of the pressed patches, which have no force arrows."""
    felt = [patch for patch in patches if patch.is_felt]
    if not felt:
        return contacts
    f_PC = (
        None
        if contacts.f_PC is None or not len(contacts)
        else np.concatenate([contacts.f_PC, np.zeros((len(felt), 3))])
    )
    return dataclasses.replace(with_patches(contacts, felt), f_PC=f_PC)


def shown_forces(contacts: Contacts, is_false: NDArray[np.bool_] | None = None) -> FloatArray:
    """The forces that are drawn, shape (k,), N; 0 at false contacts, and without forces."""
    forces = np.zeros(len(contacts)) if contacts.f_PC is None else np.linalg.norm(contacts.f_PC, axis=1)
    return forces if is_false is None else np.where(is_false, 0.0, forces)


def arrow_lengths(contacts: Contacts, is_false: NDArray[np.bool_] | None = None) -> FloatArray:
    """Lengths of the force arrows, shape (k,), m, in proportion to the forces that are drawn."""
    forces = shown_forces(contacts, is_false)
    lengths: FloatArray = forces * (LONGEST_ARROW / max(float(forces.max(initial=0.0)), 1e-12))
    return lengths
