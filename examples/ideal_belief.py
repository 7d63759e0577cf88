"""The belief of an ideal estimator on a touch of which one contact may be displaced.

It knows how `world_not_as_told.py` displaces a contact, and that the others have exactly the declared noise. Its belief
is sampled with some hundreds of effective samples, from all minima that the package's search finds with all contacts
and without each of them, and from the true pose, so that no wrong answer is due to the search. It only does not know
that the contacts are spread out over the object: to it each may be anywhere on the surface, as to the package.
"""

import dataclasses
import math

import numpy as np
from scipy.special import logsumexp, ndtr
from world_not_as_told import SIGMA_NORMAL, SIGMA_POSITION, Array, Touch

import tactopose_drake as tp
from tactopose_drake.core.evidence import ContactDoubt, ContactKinds, Evidence
from tactopose_drake.core.objectives import SurfaceContact, SurfaceDensity
from tactopose_drake.core.poses import make_poses, retract
from tactopose_drake.core.posterior import (
    Modes,
    PosteriorParams,
    SamplingParams,
    find_modes,
    indistinct_images,
    join_alike,
    make_posterior,
    weigh_modes,
)
from tactopose_drake.core.searches import LevenbergMarquardt, PairSearch, PoseProblem, make_problem
from tactopose_drake.core.shape import turn_toward
from tactopose_drake.core.synthetic import touch_surface

LEAST, MOST = 0.010, 0.030  # how far the contact is displaced, m
DISPLACEMENT = 0.012  # standard deviation of each coordinate of that, m
POINTS = 4000  # of the surface: where the displaced contact may have been
EXACT_TO = 6.5  # energy up to which the density of a contact is that of the exact surface
BLUR = 0.003  # by which noise may blur these limits, m
TINY = 1e-9  # a probability of 0 that leaves odds finite
CERTAIN = 1e6  # odds of a displaced contact that stand for certainty in the smooth objective
WORTH, HARDLY = 30.0, 14.0  # poses that cost more than the best by this are no start, or no part of the belief
POLISHED, TRIED = 60, 20  # modes that are moved to the best of so many poses around them, by the exact cost
PARAMS = PosteriorParams(
    sampling=SamplingParams(
        samples=1000,
        standard_error=0.008,
        effective_samples=400.0,
        most_samples=16_000,
        most_densities=10**6,
        most_excess_cost=13.0,
        truncation=1.0,
        least_sampled_share=1e-6,
        fewest_tiles=32,
        tail_samples=1000,
        least_tail_samples=50,
        most_tails=1000,
        least_tailed_share=0.003,
    )
)
LEVENBERG_MARQUARDT = LevenbergMarquardt(max_iterations=30, tolerance=1e-4)


class Surface:
    """Random points of an object's surface, and their normals.

    Attributes:
        model: the object.
    """

    def __init__(self, model: tp.ObjectModel) -> None:
        here = make_poses(np.eye(3), np.zeros(3))
        points = touch_surface(
            model, here, POINTS, np.random.default_rng(0), sigma_position=0.0, sigma_normal=0.0, spread=False
        )
        self.model, self._p = model, points.p_PC.astype(np.float32)
        self._n = np.asarray(points.n_PC, dtype=np.float32)
        self._square = np.square(self._p).sum(axis=1)

    def displaced(self, p_OC: Array, n_O: Array) -> Array:
        """The density of displaced contacts, points (m, 3) and normals (m, 3) in O, shape (m,).

        It is relative to that of a contact as told on a flat surface.
        """
        facing = n_O.astype(np.float32) @ self._n.T
        square = np.square(p_OC).sum(axis=1, keepdims=True).astype(np.float32) + self._square
        square -= 2.0 * p_OC.astype(np.float32) @ self._p.T
        # Beyond a few standard deviations nothing counts.
        near = (facing > 1.0 - 9.0 * SIGMA_NORMAL**2) & (square > (LEAST - BLUR) ** 2) & (square < (MOST + BLUR) ** 2)
        pair = near.ravel().nonzero()[0]
        square, energy = square.ravel()[pair], (1.0 - facing.ravel()[pair]) / SIGMA_NORMAL**2
        way = np.sqrt(square)
        # The noise blurs the limits of the displacement.
        within = ndtr((way - LEAST) / SIGMA_POSITION) - ndtr((way - MOST) / SIGMA_POSITION)
        density = within * np.exp(-energy) / (4.0 * np.pi * (MOST - LEAST) * square)
        per_point = math.sqrt(2.0 * np.pi) * SIGMA_POSITION * self.model.area / len(self._p)
        return np.asarray(per_point * np.bincount(pair // len(self._p), density, len(p_OC)))


class ExactCost:
    """The negative log posterior of poses, up to a constant, given the probability that a contact is displaced."""

    def __init__(self, surface: Surface, contacts: tp.Contacts, problem: PoseProblem, probability: float) -> None:
        self._surface, self._contacts, self._prior = surface, contacts, problem.prior
        self._touch = SurfaceContact(surface.model.grid, contacts)
        self._density = SurfaceDensity(surface.model, contacts)
        # Relative to no displaced contact, as the smooth objective has it; none of them is impossible with certainty.
        self._log_odds = math.log(odds(probability, len(contacts)))
        self._log_none = 0.0 if probability < 1.0 else -np.inf
        self._least = np.inf

    def __call__(self, X_PO: Array) -> Array:
        """Costs (B,) of poses (B, 3, 4)."""
        return np.concatenate([self._costs(part) for part in np.array_split(X_PO, 1 + len(X_PO) // 500)])

    def _costs(self, X_PO: Array) -> Array:
        density = self._density.densities(X_PO)
        energy = 0.5 * np.square(self._touch.rows_of_contacts(X_PO)[0]).sum(axis=2)
        near = density > math.exp(-EXACT_TO)
        told = np.where(near, np.log(density, where=near, out=np.zeros_like(density)), -np.maximum(energy, EXACT_TO))
        prior = np.zeros(len(X_PO)) if self._prior is None else self._prior.cost(X_PO)
        others = told.sum(axis=1, keepdims=True) - told + self._log_odds
        # The density of a displaced contact is evaluated where it may matter; it is hardly ever above 0.1.
        pose, i = np.nonzero(others + math.log(0.1) - prior[:, None] > -min(self._least, 1e9) - HARDLY)
        R = X_PO[pose, :, :3]
        p_OC = np.einsum("mab,ma->mb", R, self._contacts.p_PC[i] - X_PO[pose, :, 3])
        by_one = np.full(told.shape, -np.inf)
        with np.errstate(divide="ignore"):
            by_one[pose, i] = np.log(self._surface.displaced(p_OC, np.einsum("mab,ma->mb", R, self._contacts.n_PC[i])))
        terms = np.concatenate([others + by_one, told.sum(axis=1, keepdims=True) + self._log_none], axis=1)
        cost: Array = np.minimum(prior - logsumexp(terms, axis=1), 1e4)
        self._least = min(self._least, float(cost.min()))
        return cost


def odds(probability: float, count: int) -> float:
    """The odds that a certain one of `count` contacts is displaced, against none."""
    return CERTAIN if probability == 1.0 else probability / (1.0 - probability) / count


def find_starts(model: tp.ObjectModel, touch: Touch, generator: np.random.Generator) -> Array:
    """The true pose, and minima of the cost of all contacts and of all but each one, shape (n, 3, 4)."""
    every, starts = np.arange(len(touch.contacts)), [touch.X_PO[None]]
    for left in (every, *(np.delete(every, i) for i in every)):
        contacts = touch.contacts[left]
        problem = make_problem(model, Evidence(contacts, touch.prior, outlier_probability=0.0))
        search = PairSearch.of(model, contacts)
        search = search if touch.prior is None else search.widened()
        found = search.minimize(problem.objective, problem.space, generator)
        starts.append(found.X_PO[found.cost < found.cost[0] + HARDLY][:POLISHED])
    return np.concatenate(starts)


def believe(surface: Surface, touch: Touch, starts: Array, probability: float, generator: np.random.Generator) -> Modes:
    """The belief of the ideal estimator that a contact is displaced with this probability."""
    model, contacts = surface.model, touch.contacts
    rate = odds(probability, len(contacts)) / TINY
    of_one = ContactKinds(flipped=0.0, turned=0.0, displaced=rate, lost=0.0)
    nothing = ContactKinds(turned=0.0, displaced=0.0)
    doubt = ContactDoubt(kinds=nothing, of_one=of_one, displacement=DISPLACEMENT, doublings=((0, 0, 1.0),))
    evidence = Evidence(contacts, touch.prior, outlier_probability=TINY, doubt=doubt)
    problem = make_problem(model, evidence)
    images = indistinct_images(model, SIGMA_POSITION)
    exact = ExactCost(surface, contacts, problem, probability)
    posterior = make_posterior(model, evidence, problem, PARAMS, images)
    refined = LEVENBERG_MARQUARDT.refine(posterior.objective, starts).X_PO
    X_PO = np.concatenate([starts, refined])
    if touch.prior is None:
        X_PO = turn_toward(X_PO, X_PO[0], model.symmetries)
    likelihood, known, size = problem.doubted(problem.determining), problem.space.information, model.size
    cost, hessian = exact(X_PO), likelihood.normal_equations(X_PO).hessian
    worth = cost < cost.min() + WORTH
    X_PO, cost, hessian = X_PO[worth], cost[worth], hessian[worth]
    for _ in range(2):
        modes = find_modes(X_PO, cost, hessian, known, images, size, POLISHED)
        better = _best_around(modes, exact, generator)
        X_PO, cost = np.concatenate([X_PO, better]), np.concatenate([cost, exact(better)])
        hessian = np.concatenate([hessian, likelihood.normal_equations(better).hessian])
    modes = find_modes(X_PO, cost, hessian, known, images, size, POLISHED)
    modes = weigh_modes(modes, dataclasses.replace(posterior, exact_cost=exact), generator)
    return join_alike(modes, model)


def _best_around(modes: Modes, exact: ExactCost, generator: np.random.Generator) -> Array:
    """The pose of least exact cost among random ones around each mode, shape (n, 3, 4)."""
    root, X_PO = np.linalg.cholesky(modes.mixture.covariance), modes.mixture.X_PO
    white = 0.7 * generator.normal(size=(len(X_PO), TRIED, 6))
    tried = retract(X_PO[:, None], np.einsum("nij,nkj->nki", root, white))
    best = exact(tried.reshape(-1, 3, 4)).reshape(len(X_PO), TRIED).argmin(axis=1)
    return np.asarray(tried[np.arange(len(X_PO)), best])
