"""Joins modes that are nearly symmetric images of each other and that the touch cannot tell apart.

A scanned can has a bumpy surface, so the posterior over its spin has many modes where that of an ideal can is flat; two
sides of a bottle may differ by a fraction of a millimetre. Where such modes share their probability, they become one
mode, with the rotation between them as a free direction. Where one of them has nearly all of it, the touch tells them
apart, and each stays a mode of its own.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.poses import compose, increments_between, increments_of_images, log_so3
from tactopose_drake.core.posterior.gaussian_mixture import GaussianMixture
from tactopose_drake.core.posterior.modes import Modes, determined_part, increments_of_one_metre
from tactopose_drake.core.posterior.posterior_params import DEFAULT_PARAMS, ModeParams
from tactopose_drake.core.shape.free_spin import continuous_turns, turn_toward
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.shape.symmetry import RotationalSymmetry
from tactopose_drake.core.validation import FloatArray

# A symmetry's images are distinguishable when it displaces the surface by more than this many sigmas of the contacts.
_DISTINCT_SIGMAS = 1.0
# Relative to a covariance's trace: regularises its smallest eigenvalues.
_ROUNDING = 1e-15
# A free direction is distinct from the turns when more than this share of its length lies across them.
_LEAST_ACROSS = 0.5


def indistinct_images(model: ObjectModel, sigma: float) -> FloatArray:
    """Returns the finite symmetries that no touch with contacts of standard deviation sigma, m, can tell apart.

    Symmetries given by the user always hold, whatever the surface looks like.

    Returns:
        Poses X_OO', the identity first, shape (g, 3, 4).
    """
    if model.symmetries_are_given:
        return model.symmetry_poses
    indistinct = model.symmetry_misfits <= _DISTINCT_SIGMAS * sigma
    indistinct[0] = True
    return model.symmetry_poses[indistinct]


def join_alike(modes: Modes, model: ObjectModel, params: ModeParams = DEFAULT_PARAMS.modes) -> Modes:
    """Joins modes that near symmetries map onto each other, unless one of them has nearly all of their probability.

    Args:
        modes: in descending order of probability.
        model: the object with its near symmetries, and with the finite ones that `find_modes` may have left unmerged.
        params: the probability share that settles which mode it is, and how uncertain a free turn is.
    """
    mixture, axes = modes.mixture, [each for each in model.near_symmetries if each.is_continuous]
    if len(mixture) == 1 or (not axes and len(model.symmetry_poses) == 1):
        return modes
    left, joined = np.arange(len(mixture)), []
    while len(left):
        family = _family(mixture, left, model.symmetry_poses, axes, params.same_sigmas)
        mass = mixture.weights[family.index]
        if mass[0] >= params.answer_share * mass.sum():
            family = family.first()
        joined.append(_join(modes, family, axes, model.size, params))
        left = np.setdiff1d(left, family.index)
    joined.sort(key=lambda one: -one.weight)
    return dataclasses.replace(
        modes,
        mixture=GaussianMixture(
            np.array([mixture.X_PO[one.index] for one in joined]),
            np.array([one.weight for one in joined]),
            np.array([one.covariance for one in joined]),
        ),
        cost=np.array([modes.cost[one.index] for one in joined]),
        free_directions=tuple(one.free_directions for one in joined),
    )


@dataclasses.dataclass(frozen=True)
class _Family:
    """Modes that are alike, the most probable one first; n of them.

    Attributes:
        index: of the modes, shape (n,).
        residual: increments from the first mode to each, after turning that toward the first, shape (n, 6).
        covariance: of the turned modes, shape (n, 6, 6).
        turns: angles about the near symmetries' axes from the first mode to each, shape (n, c), rad.
    """

    index: NDArray[np.intp]
    residual: FloatArray
    covariance: FloatArray
    turns: FloatArray

    def first(self) -> "_Family":
        """The first one alone."""
        return _Family(self.index[:1], self.residual[:1], self.covariance[:1], self.turns[:1])


@dataclasses.dataclass(frozen=True)
class _MergedMode:
    """The mode that replaces a family: the index of the mode whose pose it has, and its own statistics."""

    index: int
    weight: float
    covariance: FloatArray
    free_directions: FloatArray


def _family(
    mixture: GaussianMixture,
    left: NDArray[np.intp],
    images: FloatArray,
    axes: Sequence[RotationalSymmetry],
    same_sigmas: float,
) -> _Family:
    """Those of the modes left (in descending probability) that an image and turns about the axes map to the first."""
    X_first, count = mixture.X_PO[left[0]], len(left)
    by_images = compose(mixture.X_PO[left][:, None], images[None]).reshape(-1, 3, 4)
    turned = turn_toward(by_images, X_first, axes)
    residual = increments_between(np.broadcast_to(X_first, turned.shape), turned)
    nearest = np.linalg.norm(residual[:, :3].reshape(count, -1, 3), axis=2).argmin(axis=1)
    chosen = np.arange(count) * len(images) + nearest
    residual, turned = residual[chosen], turned[chosen]
    J = increments_of_images(mixture.X_PO[left], turned)
    covariance = J @ mixture.covariance[left] @ np.swapaxes(J, 1, 2)
    spins = log_so3(np.swapaxes(turned[:, :, :3], 1, 2) @ by_images[chosen][:, :, :3])
    turns = spins @ np.array([each.axis for each in axes]).reshape(-1, 3).T
    directions = continuous_turns(axes, X_first)
    spread = covariance + covariance[0] + np.pi**2 * directions.T @ directions
    spread += _ROUNDING * np.trace(spread, axis1=1, axis2=2)[:, None, None] * np.eye(6)
    distance = np.einsum("ni,ni->n", residual, np.linalg.solve(spread, residual[..., None])[..., 0])
    alike = distance <= same_sigmas**2
    alike[0] = True
    return _Family(left[alike], residual[alike], covariance[alike], turns[alike])


def _join(
    modes: Modes, family: _Family, axes: Sequence[RotationalSymmetry], size: float, params: ModeParams
) -> _MergedMode:
    """Merges a family into one mode at its first mode's pose, with the second moment of all about that pose."""
    index = int(family.index[0])
    mass = modes.mixture.weights[family.index]
    if len(family.index) == 1:
        return _MergedMode(index, float(mass[0]), modes.mixture.covariance[index], modes.free_directions[index])
    share = mass / mass.sum()
    directions = continuous_turns(axes, modes.mixture.X_PO[index])
    moment = np.einsum("n,nc,nd->cd", share, family.turns, family.turns)
    covariance = (
        np.einsum("n,nij->ij", share, family.covariance)
        + np.einsum("n,ni,nj->ij", share, family.residual, family.residual)
        + directions.T @ moment @ directions
    )
    variance = np.einsum("ci,ij,cj->c", directions[:, :3], covariance[:3, :3], directions[:, :3])
    turned = directions[np.sqrt(variance) > 2.0 * params.free_share]
    return _MergedMode(index, float(mass.sum()), covariance, _with_turns(modes.free_directions[index], turned, size))


def _with_turns(free: FloatArray, turns: FloatArray, size: float) -> FloatArray:
    """Orthonormal rows that span the turns (c, 6) and the free directions (f, 6) that are not nearly one of these."""
    if not len(turns):
        return free
    if len(free):
        units = increments_of_one_metre(size)
        others = determined_part(free, turns, size)
        across, whole = np.linalg.norm(others / units, axis=1), np.linalg.norm(free / units, axis=1)
        turns = np.concatenate([turns, others[across > _LEAST_ACROSS * whole]])
    rows: FloatArray = np.linalg.qr(turns.T)[0].T
    return rows
