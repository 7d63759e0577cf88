"""Mass, mean and covariance of each mode by importance sampling of the exact posterior.

Laplace's approximation takes each mode for a Gaussian of the curvature at its minimum. Real modes have kinks where a
contact passes an edge, and bend where a direction is hardly determined: a Gaussian that fits in the middle leaves the
valley. Therefore each mode is covered by tiles: proposal densities like Laplace's, placed along the valley's floor.
Samples of their mixture are weighted by the ratio of the exact posterior to the mixture [OZ00], and give each mode's
mass, pose and covariance. Modes with hardly any barrier between them are joined. A sample far out, where few are drawn,
could outweigh thousands of others, so weights are truncated relative to their mean [I08].

Source: [OZ00] A. Owen and Y. Zhou, Safe and effective importance sampling, J. Am. Stat. Assoc. 95, 2000 (deterministic
mixture weights). [CDG08] O. Cappe et al., Adaptive importance sampling in general mixture classes, Stat. Comput. 18,
2008. [CMMR12] J.-M. Cornuet et al., Adaptive multiple importance sampling, Scand. J. Stat. 39, 2012. [I08] E. Ionides,
Truncated importance sampling, J. Comput. Graph. Stat. 17, 2008. [N34] J. Neyman, On the two different aspects of the
representative method, J. R. Stat. Soc. 97, 1934.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.plain_values import copied
from tactopose_drake.core.posterior.doubted_spread import widen_by_doubt
from tactopose_drake.core.posterior.importance_sampling_kernels import Draws, WeightSummary, weigh
from tactopose_drake.core.posterior.joined_modes import Families
from tactopose_drake.core.posterior.mode_cover import (
    Cover,
    cost_within_modes,
    cover_modes,
    density_by_contact,
    join_modes,
    minima_between,
    tile_samples,
)
from tactopose_drake.core.posterior.mode_moments import with_moments
from tactopose_drake.core.posterior.mode_moments_kernels import WeightedSamples
from tactopose_drake.core.posterior.modes import Modes
from tactopose_drake.core.posterior.posterior import Posterior
from tactopose_drake.core.posterior.student_t_mixture import StudentTMixture
from tactopose_drake.core.shape.free_spin import TURN_VOLUME
from tactopose_drake.core.validation import FloatArray


class Samples(NamedTuple):
    """Importance samples of the posterior from the proposals of g modes.

    Attributes:
        X_PO: poses, shape (B, 3, 4).
        cost: their exact costs, shape (B,).
        density: of each mode's proposals at the samples, times the number of all samples, shape (B, g).
        by_contact: the same of the draws by a single contact, in parts; none without. Each counts for the nearest mode.
        proposal: what has been sampled so far: the proposals of all rounds in one mixture.
        times: how many times the proposals of each mode have been sampled, shape (g,).
        each: number of samples of each component, in sample order, shape (n,); one that is sampled again counts anew.
        group: the mode of each of these, shape (n,).
        weights: importance weights split among the modes, relative to the density exp(lowest - cost), shape (B, g).
        variance: contribution of each mode's samples to the variance of the noisiest family's probability, shape (g,).
        summary: of the weights.
    """

    X_PO: FloatArray
    cost: FloatArray
    density: FloatArray
    by_contact: tuple[FloatArray, ...]
    proposal: StudentTMixture
    times: NDArray[np.intp]
    each: NDArray[np.intp]
    group: NDArray[np.intp]
    weights: FloatArray
    variance: FloatArray
    summary: WeightSummary

    @property
    def draws(self) -> Draws:
        """The samples as the weighting kernel reads them; the draws by a contact come first, as another component."""
        count, group, density = self.each, self.group, self.density
        if self.by_contact:
            count, group = np.insert(count, 0, len(self.cost) - count.sum()), np.insert(group, 0, 0)
            density = density + np.concatenate(self.by_contact)
        return Draws(self.cost, density, count, group)

    @property
    def once(self) -> NDArray[np.intp]:
        """How many samples one pass over the proposal draws for each mode, shape (g,)."""
        return np.bincount(self.proposal.group, self.proposal.count, len(self.times)).astype(np.intp)


class SamplingState(NamedTuple):
    """State of the sampling, which `sample_on` advances by steps of about equal duration.

    Attributes:
        modes: by Laplace's approximation; once done, as the samples give them.
        cover: the proposals that cover the sampled modes; None once done, or where there can be none.
        families: which of the sampled modes are one; None before that is tested.
        samples: drawn so far; None before the first round.
        X_between: further minima between the modes, found from the samples, shape (n, 3, 4); None before they are
            needed.
        is_joined: whether modes have been joined through the minima found from the samples, or need not be.
    """

    modes: Modes
    cover: Cover | None
    families: Families | None = None
    samples: Samples | None = None
    X_between: FloatArray | None = None
    is_joined: bool = False


def weigh_modes(modes: Modes, posterior: Posterior, generator: np.random.Generator) -> Modes:
    """Returns the modes with mass and covariance from importance samples of the exact posterior.

    Each is then widened for single contacts that may be false, which few of the samples show; see `widen_by_doubt`.
    """
    state = begin_sampling(modes, posterior, generator)
    while state.cover is not None:
        state = sample_on(state, posterior, generator)
    return widen_by_doubt(state.modes, posterior)


def begin_sampling(modes: Modes, posterior: Posterior, generator: np.random.Generator) -> SamplingState:
    """The first step: covers the modes with proposals, or falls back to Laplace's approximation if it cannot."""
    return SamplingState(modes, cover_modes(modes, posterior, generator))


def sample_on(state: SamplingState, posterior: Posterior, generator: np.random.Generator) -> SamplingState:
    """The next step for modes that are covered: join, sample, find minima between, join again, resample, or finish."""
    modes, cover, families, samples, X_between, is_joined = state
    assert cover is not None
    if families is None:
        families = join_modes(cover, posterior)
    elif samples is None:
        samples = _first_round(cover, families, posterior, generator)
        is_joined = samples.summary.standard_error <= posterior.params.sampling.standard_error
    elif not is_joined and X_between is None:  # Minima between the modes may have been missed.
        X_between = minima_between(samples.X_PO, samples.weights, cover, posterior)
    elif not is_joined:
        families, is_joined = join_modes(cover, posterior, X_between), True
        samples = _weighed_anew(samples, cover, families, posterior)
    elif (further := _next_round(samples, cover, families, posterior, generator)) is not None:
        samples = further
    else:
        return SamplingState(_as_sampled(modes, cover, families, samples, posterior), None)
    return SamplingState(modes, cover, families, samples, X_between, is_joined)


def _as_sampled(modes: Modes, cover: Cover, families: Families, samples: Samples, posterior: Posterior) -> Modes:
    """Returns the modes with the masses and moments of their samples."""
    close, worthy, weights, summary = cover.close, cover.worthy, samples.weights, samples.summary
    every = np.exp(cover.laplace + summary.lowest) * (2.0 * np.pi) ** (3.0 - 0.5 * len(posterior.turn_axes))
    # Samples do not count for modes of much higher cost than the best: these keep Laplace's approximation.
    cost = modes.cost[close[worthy]]
    counts = cost < cost.min() + posterior.params.sampling.most_excess_cost
    every[worthy[counts]] = weights[:, counts].sum(axis=0)
    masses = modes.mixture.weights * (every.sum() / modes.mixture.weights[close].sum())
    masses[close] = every
    mass = masses.sum()
    if not mass > 0.0:  # No sample counts, nor has a mode that was not sampled any weight.
        return modes
    weighted = WeightedSamples(cover.X_PO, samples.X_PO, weights)
    found = with_moments(modes, close[worthy], masses / mass, weighted, families, posterior)
    if found is None:
        return modes  # One sample outweighs all others; Laplace's approximation is more reliable.
    whole = mass + summary.mass - weights.sum()  # Includes the samples that belong to no mode.
    log_mass = float(np.log(whole) - summary.lowest + np.log(TURN_VOLUME[len(posterior.turn_axes)]))
    return copied(found, log_mass=log_mass, standard_error=summary.standard_error)


def _first_round(cover: Cover, families: Families, posterior: Posterior, generator: np.random.Generator) -> Samples:
    """Draws and weights the samples of the first proposal."""
    proposal, g = cover.proposal, len(cover.X_PO)
    X_tiles = proposal.sample(generator)
    X_PO = np.concatenate([cover.by_contact.X_PO, X_tiles])
    density = np.zeros((len(X_PO), g))
    proposal.add_to(density, X_PO)
    cost = np.concatenate([cover.cost_by_contact, cost_within_modes(X_tiles, cover.X_PO, posterior)])
    by_contact = density_by_contact(X_PO, cover, posterior)
    nothing = WeightSummary(cover.lowest, 0.0, 0.0, 0.0)
    drawn = np.ones(g, dtype=np.intp), proposal.count, proposal.group
    samples = Samples(X_PO, cost, density, by_contact, proposal, *drawn, density, density[0], nothing)
    return _weighed_anew(samples, cover, families, posterior)


def _weighed_anew(samples: Samples, cover: Cover, families: Families, posterior: Posterior) -> Samples:
    """Recomputes the weights for these families, in new arrays."""
    params, weights, variance = posterior.params.sampling, np.empty_like(samples.density), np.empty(len(cover.X_PO))
    limits = params.most_excess_cost, params.truncation
    summary = weigh(samples.draws, families.family, cover.lowest, *limits, weights, variance)
    return samples._replace(weights=weights, variance=variance, summary=summary)


def _next_round(
    samples: Samples, cover: Cover, families: Families, posterior: Posterior, generator: np.random.Generator
) -> Samples | None:
    """Adds a round of samples. Returns None if they are accurate enough, or the limit on samples is reached.

    While the effective sample size is small, a new proposal is placed about the weighted samples [CDG08], and all
    samples are weighted by the mixture of all proposals [CMMR12]. This splits heavy samples into many light ones, which
    favours likely regions a little. Once the effective sample size suffices, the existing proposals are sampled again.
    """
    params, summary, drawn = posterior.params.sampling, samples.summary, len(samples.X_PO)
    effective = summary.effective_samples
    sure = summary.standard_error <= params.standard_error and effective >= params.effective_samples
    if sure or effective == 0.0:
        return None
    if samples.times.max() > 1 or effective >= max(params.effective_samples, params.efficiency * drawn):
        times = _times_wanted(samples, posterior)
        if (times == samples.times).all():
            return None
        joined = _sample_again(samples, times, cover, posterior, generator)
    else:
        count = max(params.round_of(cover.tiles), int(params.growth * drawn))
        if drawn + count > posterior.most_samples:
            return None
        proposal = tile_samples(samples.X_PO, samples.weights, cover, count, posterior)
        density = samples.density.copy()
        proposal.add_to(density, samples.X_PO)
        whole = samples._replace(density=density, proposal=samples.proposal.joined(proposal))
        joined = _append(whole, proposal, cover, posterior, generator)
    return _weighed_anew(joined, cover, families, posterior)


def _times_wanted(samples: Samples, posterior: Posterior) -> NDArray[np.intp]:
    """How many times to sample each mode's proposals (g,) for the noisiest probability to be accurate enough.

    If n samples of a mode contribute v to the variance, m samples contribute n v / m; for a given total this is least
    with m proportional to sqrt(n v) [N34]. As v is itself estimated from few samples, half of the total is allocated in
    proportion to n.
    """
    params, once, drawn = posterior.params.sampling, samples.once, len(samples.X_PO)
    count = samples.times * once
    squares = count * samples.variance
    noise = np.sqrt(squares)
    shares = 0.5 * (count / drawn + noise / max(noise.sum(), 1e-300))
    wanted = float((squares / shares).sum()) / max(params.standard_error, 1e-9) ** 2
    wanted = min(max(wanted, drawn + params.samples), posterior.most_samples)
    more = np.maximum(shares * wanted / once - samples.times, 0.0)
    room = max(posterior.most_samples - drawn, 0)
    if np.ceil(more) @ once > room:
        more = np.floor(more * min(1.0, room / (more @ once)))
    return np.asarray(samples.times + np.ceil(more).astype(np.intp))


def _sample_again(
    samples: Samples, times: NDArray[np.intp], cover: Cover, posterior: Posterior, generator: np.random.Generator
) -> Samples:
    """Samples the proposals again until those of each mode have been sampled `times` (g,) times in all."""
    again = copied(samples.proposal, count=(times - samples.times)[samples.proposal.group] * samples.proposal.count)
    joined = _append(samples._replace(density=samples.density / samples.times), again, cover, posterior, generator)
    return joined._replace(density=times * joined.density, times=times)


def _append(
    samples: Samples, sampled: StudentTMixture, cover: Cover, posterior: Posterior, generator: np.random.Generator
) -> Samples:
    """Appends samples of a mixture, with the density of the whole proposal there; the weights are left as they are."""
    X_PO = sampled.sample(generator)
    density = np.zeros((len(X_PO), len(cover.X_PO)))
    samples.proposal.add_to(density, X_PO)
    return samples._replace(
        X_PO=np.concatenate([samples.X_PO, X_PO]),
        cost=np.concatenate([samples.cost, cost_within_modes(X_PO, cover.X_PO, posterior)]),
        density=np.concatenate([samples.density, density]),
        by_contact=(*samples.by_contact, *density_by_contact(X_PO, cover, posterior)),
        each=np.concatenate([samples.each, sampled.count]),
        group=np.concatenate([samples.group, sampled.group]),
    )
