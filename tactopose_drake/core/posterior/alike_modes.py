"""Modes that are alike because the object nearly is: what a touch does not tell apart is one hypothesis.

A scan of a can is bumpy, so its spin has many minima where that of a can has none; two sides of a bottle differ by a
fraction of a millimetre. Where such modes share the mass among them, they are one mode, and the turn between them is
free. Where one of them has nearly all of it, the touch tells them apart, and each keeps its own.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.poses import compose, increments_between, increments_of_images, log_so3
from tactopose_drake.core.posterior.gaussian_mixture import GaussianMixture
from tactopose_drake.core.posterior.hypotheses import Modes, determined_part, increments_of_one_metre
from tactopose_drake.core.posterior.posterior_params import DEFAULT_PARAMS, ModeParams
from tactopose_drake.core.shape.free_spin import continuous_turns, turn_toward
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.shape.symmetry import RotationalSymmetry
from tactopose_drake.core.validation import FloatArray

# Over the contacts' sigma, how far a symmetry must leave the surface off for a touch to tell its images apart.
_TOLD_APART = 1.0
# Over a spread's trace, what is certain of its other entries.
_ROUNDING = 1e-15
# Of a free direction, how much of the way of a turn it must not share to be another one.
_ANOTHER = 0.5


def indistinct_images(model: ObjectModel, sigma: float) -> FloatArray:
    """Those of the object's finite symmetries that no touch of contacts known to sigma, m, tells apart.

    Symmetries that were told hold, whatever the surface says.

    Returns:
        Poses X_OO', the identity first, shape (g, 3, 4).
    """
    if model.symmetries_are_given:
        return model.symmetry_poses
    indistinct = model.symmetry_misfits <= _TOLD_APART * sigma
    indistinct[0] = True
    return model.symmetry_poses[indistinct]


def join_alike(modes: Modes, model: ObjectModel, params: ModeParams = DEFAULT_PARAMS.modes) -> Modes:
    """The modes, of which those that near symmetries map onto each other are one where none has nearly all their mass.

    Args:
        modes: by falling probability.
        model: the object, with its near symmetries, and the finite ones that `find_modes` may have left apart.
        params: the share of the mass that says which mode it is, and how wide a turn is free.
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
        joined.append(_as_one(modes, family, axes, model.size, params))
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
        residual: increments (n, 6) from the first to each when that is turned toward it.
        covariance: of the modes so turned, shape (n, 6, 6).
        turns: from the first to each, about the near symmetries' axes, shape (n, c), rad.
    """

    index: NDArray[np.intp]
    residual: FloatArray
    covariance: FloatArray
    turns: FloatArray

    def first(self) -> "_Family":
        """The first one alone."""
        return _Family(self.index[:1], self.residual[:1], self.covariance[:1], self.turns[:1])


@dataclasses.dataclass(frozen=True)
class _One:
    """One mode made of a family: whose pose it has, and what it says."""

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
    """The modes among those left (falling probability) that an image and turns about axes bring to the first one."""
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


def _as_one(modes: Modes, family: _Family, axes: Sequence[RotationalSymmetry], size: float, params: ModeParams) -> _One:
    """A family as one mode: its first one's pose, and the spread of all about that."""
    index = int(family.index[0])
    mass = modes.mixture.weights[family.index]
    if len(family.index) == 1:
        return _One(index, float(mass[0]), modes.mixture.covariance[index], modes.free_directions[index])
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
    return _One(index, float(mass.sum()), covariance, _with_turns(modes.free_directions[index], turned, size))


def _with_turns(free: FloatArray, turns: FloatArray, size: float) -> FloatArray:
    """Free directions (f, 6) and turns (c, 6) as orthonormal rows; a free direction that is nearly a turn is that."""
    if not len(turns):
        return free
    if len(free):
        units = increments_of_one_metre(size)
        others = determined_part(free, turns, size)
        way, whole = np.linalg.norm(others / units, axis=1), np.linalg.norm(free / units, axis=1)
        turns = np.concatenate([turns, others[way > _ANOTHER * whole]])
    rows: FloatArray = np.linalg.qr(turns.T)[0].T
    return rows
