"""Poses drawn from all those that a single contact leaves.

They form a family that extends over the whole surface and all spins about the normal. A search finds only some of its
minima if more is known, and tiles reach only as far as the search has led. But poses can be drawn from the family
itself: any place of the surface may be the one that is touched, in any spin. Weighted by what else is known, the draws
cover each of its parts in proportion to its probability.

Only a prior distinguishes rotations about a continuous axis. Without one the draws are turned toward the modes; their
density is then over the other directions, that is, it is integrated over the turns.

A prior leaves a small part of the family. For each place the prior's density over the spin is nearly a Gaussian;
places and spins drawn from these are resampled by the ratio of the prior's density to theirs [R88].

Source: [R88] D. Rubin, Using the SIR algorithm to simulate posterior distributions, Bayesian Statistics 3, 1988.
"""

import functools
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.evidence.gaussian_prior import GaussianPrior
from tactopose_drake.core.objectives.pose_prior import PriorObjective
from tactopose_drake.core.objectives.surface_density import SurfaceDensity
from tactopose_drake.core.poses import axes_across, exp_so3, make_poses
from tactopose_drake.core.shape.free_spin import TURN_VOLUME, turn_toward_nearest
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import FloatArray

# The draws' standard deviations over those that are told: the noise may be larger, and then poses farther off weigh.
_WIDER = 1.5
_TURN = 2.0 * math.pi
# Places and normals farther from what the prior expects, in standard deviations, are not drawn.
_FARTHEST = 4.0
# The drawn spins' standard deviations over those of the Gaussians that the prior leaves, and at most, rad.
_WIDER_SPIN, _WIDEST_SPIN = 2.0, 2.0
# Near a prior, how many places are considered for each pose that is tried, and for each that is kept.
_TRIED, _KEPT = 4, 8
# With a smaller effective sample size of either, their density would not be known well enough.
_LEAST_EFFECTIVE = 30.0


class ContactDraws(NamedTuple):
    """Poses drawn from all those that a single contact leaves.

    Attributes:
        X_PO: the poses, shape (n, 3, 4).
        scale: their number over the integral of the density that they are drawn from.
    """

    X_PO: FloatArray
    scale: float


class _Spins(NamedTuple):
    """The poses that a prior leaves for each of n places: its density over the spin is nearly a Gaussian.

    Attributes:
        R_PO: the rotations that are nearest to the prior's, shape (n, 3, 3).
        mean: of the spin from there, rad, shape (n,).
        sigma: its standard deviation, rad, shape (n,).
        log_mass: logarithm of the integral of the density, up to a constant, shape (n,).
    """

    R_PO: FloatArray
    mean: FloatArray
    sigma: FloatArray
    log_mass: FloatArray


class SingleContact:
    """The density of poses that a single contact with its normal leaves: uniform over the surface and the spin.

    The noise is larger than told, see above, but otherwise as in `SurfaceDensity`. A prior multiplies the density.
    """

    def __init__(self, model: ObjectModel, contact: Contacts, prior: GaussianPrior | None = None) -> None:
        """The density of poses by the only one of the contacts, in P, and a prior."""
        assert contact.n_PC is not None
        self._model, self._prior = model, prior
        self._p_PC, self._n_PC = contact.p_PC[0], contact.n_PC[0]
        self._sigma_position = _WIDER * float(np.max(contact.sigma_position))
        self._sigma_normal = _WIDER * float(np.max(contact.sigma_normal))
        self._axes = model.continuous_symmetries if prior is None else ()

    @functools.cached_property
    def _surface(self) -> SurfaceDensity:
        """The density of the contact's measurement."""
        contact = Contacts(
            self._p_PC[None], self._n_PC[None], sigma_position=self._sigma_position, sigma_normal=self._sigma_normal
        )
        return SurfaceDensity(self._model, contact)

    @functools.cached_property
    def _blocks(self) -> NDArray[np.float32]:
        """The surface's discs; see `Surfels.blocks`."""
        return self._model.surfels(self._sigma_position).blocks

    @functools.cached_property
    def _area(self) -> float:
        """The discs' area, m^2."""
        return float(self._blocks[:, 6].sum(dtype=np.float64))

    def density(self, X_PO: FloatArray) -> FloatArray:
        """The density at poses (B, 3, 4) with respect to their volume, shape (B,), 1/(rad^3 m^3).

        It is integrated over turns that change nothing, and not normalised if there is a prior; see
        `ContactDraws.scale`.
        """
        # The integrals of `SurfaceDensity` over the place, the distance from it, the normal's tilt, and the spin.
        scale = self._area * math.sqrt(_TURN) * self._sigma_position * (_TURN * self._sigma_normal**2 * _TURN)
        density = np.asarray(self._surface.densities(X_PO)[:, 0] / (scale / TURN_VOLUME[len(self._axes)]))
        return density if self._prior is None else density * np.exp(-PriorObjective(self._prior).cost(X_PO))

    def sample(self, places: int, generator: np.random.Generator) -> ContactDraws:
        """Draws poses that touch places evenly spread over the surface: one each, and with a prior an eighth of these.

        There are none if the prior leaves next to nothing of the family, or is narrower than what the contact tells.
        """
        if self._prior is not None:
            return self._sample_near(self._prior, places, generator)
        p_OC, n_OC = self._places(_columns(self._blocks, self._blocks[:, 6] > 0.0), places, generator)
        spin = _TURN * generator.random(places)
        R_PO = _frames(np.tile(self._n_PC, (places, 1)), spin) @ np.swapaxes(_frames(n_OC, np.zeros(places)), 1, 2)
        return ContactDraws(self._touching(R_PO, p_OC), float(places))

    def turned(self, X_PO: FloatArray, X_mode: FloatArray) -> FloatArray:
        """Poses (n, 3, 4), each turned toward the nearest of the modes (g, 3, 4) if turns change nothing."""
        return turn_toward_nearest(X_PO, X_mode, self._axes, 0.5 * self._model.size)

    def _sample_near(self, prior: GaussianPrior, places: int, generator: np.random.Generator) -> ContactDraws:
        """The draws near a prior: place, spin given the place, and resampling by what is wanted over what is drawn."""
        none, near = ContactDraws(np.empty((0, 3, 4)), 0.0), self._near_discs(prior)
        if not len(near):
            return none
        p_OC, n_OC = self._places(near, places, generator)
        spins = self._spins(p_OC, n_OC, prior)
        mass = np.exp(spins.log_mass - spins.log_mass.max())
        place = _systematic(mass, places // _TRIED, generator)
        sigma = np.minimum(_WIDER_SPIN * spins.sigma[place], _WIDEST_SPIN)
        turn = sigma * generator.normal(size=len(place))
        R_PO = exp_so3((spins.mean[place] + turn)[:, None] * self._n_PC) @ spins.R_PO[place]
        X_PO = self._touching(R_PO, p_OC[place])
        turns = turn[:, None] + _TURN * np.arange(-2.0, 3.0)
        drawn = np.exp(-0.5 * (turns / sigma[:, None]) ** 2).sum(axis=1) / (math.sqrt(_TURN) * sigma)
        drawn *= mass[place] / mass.mean()
        share = near[:, 6].sum() / self._area
        ratio = share / _TURN * np.exp(-PriorObjective(prior).cost(X_PO)) / drawn
        if not min(_effective(mass), _effective(ratio)) > _LEAST_EFFECTIVE:
            return none
        kept = _systematic(ratio, places // _KEPT, generator)
        return ContactDraws(X_PO[kept], len(kept) / float(ratio.mean()))

    def _near_discs(self, prior: GaussianPrior) -> FloatArray:
        """The discs (m, 9) that may be touched according to the prior."""
        center, normal, R_PO = self._blocks[:, :3], self._blocks[:, 3:6], prior.mean[:, :3]
        expected, n_OC = (self._p_PC - prior.mean[:, 3]) @ R_PO, self._n_PC @ R_PO
        square_arm, square = (np.square(each).sum(axis=1) for each in (center, center - expected[:, None]))
        near = square < _FARTHEST**2 * (prior.sigma_translation**2 + prior.sigma_rotation**2 * square_arm)
        near &= np.einsum("i,bij->bj", n_OC, normal) > math.cos(min(_FARTHEST * prior.sigma_rotation, math.pi))
        return _columns(self._blocks, near & (self._blocks[:, 6] > 0.0))

    def _spins(self, p_OC: FloatArray, n_OC: FloatArray, prior: GaussianPrior) -> _Spins:
        """What the prior leaves if places with these normals, shapes (n, 3), are touched."""
        by_rotation, by_translation = prior.sigma_rotation**-2, prior.sigma_translation**-2
        n_PO = n_OC @ prior.mean[:, :3].T
        axis = np.cross(n_PO, self._n_PC)
        sine = np.linalg.norm(axis, axis=1)
        tilt = np.arctan2(sine, n_PO @ self._n_PC)
        R_PO = exp_so3((tilt / np.maximum(sine, 1e-12))[:, None] * axis) @ prior.mean[:, :3]
        p_PC = np.einsum("bij,bj->bi", R_PO, p_OC)
        away, turned = self._p_PC - p_PC - prior.mean[:, 3], np.cross(self._n_PC, p_PC)
        information = by_rotation + by_translation * np.square(turned).sum(axis=1)
        mean = by_translation * (away * turned).sum(axis=1) / information
        square = by_rotation * tilt**2 + by_translation * np.square(away).sum(axis=1) - information * mean**2
        return _Spins(R_PO, mean, information**-0.5, -0.5 * (square + np.log(information)))

    def _places(self, discs: FloatArray, count: int, generator: np.random.Generator) -> tuple[FloatArray, FloatArray]:
        """Places and their normals, shapes (count, 3), evenly spread over discs (n, 9), with the contact's noise."""
        disc = discs[_systematic(discs[:, 6], count, generator)]
        centre, normal, variance, roughness = disc[:, :3], disc[:, 3:6], disc[:, 7:8], disc[:, 8:9]
        white, across = generator.normal(size=(count, 7)), np.stack(axes_across(normal), axis=1)
        in_disc = np.sqrt(variance) * white[:, :2]
        tilt = np.sqrt(self._sigma_normal**2 + roughness) * white[:, 2:4]
        p_OC = centre + np.einsum("bi,bij->bj", in_disc, across) + self._sigma_position * white[:, 4:]
        n_OC = normal + np.einsum("bi,bij->bj", tilt, across)
        n_OC /= np.linalg.norm(n_OC, axis=1, keepdims=True)
        return p_OC, n_OC

    def _touching(self, R_PO: FloatArray, p_OC: FloatArray) -> FloatArray:
        """The poses (n, 3, 4) in these rotations that put points p_OC (n, 3) at the contact."""
        return make_poses(R_PO, self._p_PC - np.einsum("bij,bj->bi", R_PO, p_OC))


def _columns(blocks: NDArray[np.float32], chosen: NDArray[np.bool_]) -> FloatArray:
    """The columns of `Surfels.blocks` (b, 9, BLOCK) for the chosen discs (b, BLOCK), shape (m, 9)."""
    return blocks.swapaxes(1, 2)[chosen].astype(np.float64)


def _systematic(weights: FloatArray, count: int, generator: np.random.Generator) -> NDArray[np.intp]:
    """Indices (count,) drawn in proportion to weights (n,), as evenly as can be."""
    ends = weights.cumsum()
    along = (np.arange(count) + generator.random()) * (ends[-1] / count)
    return np.asarray(np.minimum(ends.searchsorted(along, side="right"), len(ends) - 1))


def _effective(weights: FloatArray) -> float:
    """The effective sample size of weights (n,)."""
    return float(weights.sum() ** 2 / max(np.square(weights).sum(), 1e-300))


def _frames(z: FloatArray, angle: FloatArray) -> FloatArray:
    """Rotation matrices (n, 3, 3) with third columns z (n, 3), unit vectors; they differ by the angles (n,) about z."""
    x, y = axes_across(z)
    cosine, sine = np.cos(angle)[:, None], np.sin(angle)[:, None]
    return np.stack([cosine * x + sine * y, cosine * y - sine * x, z], axis=2)
