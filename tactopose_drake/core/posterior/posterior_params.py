"""What is assumed when poses are weighed against each other, and how much work goes into it: a dataclass for each part.

They are no options of an estimate: `DEFAULT_PARAMS` are those of all of them.
"""

import dataclasses


@dataclasses.dataclass(frozen=True, kw_only=True, slots=True)
class ModeParams:
    """Which poses are one mode, what a touch leaves open, and when a mode is the answer."""

    same_sigmas: float = 3.0  # standard deviations within which two poses are one mode
    free_share: float = 0.1  # of the object's size: a direction is free when the touch fixes the surface no better
    most_modes: int = 64  # that are weighed, but where more hypotheses are asked for
    answer_share: float = 0.9  # of the probability that the first mode must carry to be called the answer
    # Fewer contacts and pads leave whole families of poses where nothing else is known, whatever that mode carries.
    fewest_contacts: int = 3


@dataclasses.dataclass(frozen=True, kw_only=True, slots=True)
class PlausibilityParams:
    """When noise alone explains a touch."""

    # Contacts' residuals that noise alone leaves more rarely than with this chance are none of it.
    least_contact_chance: float = 1e-3
    least_pad_chance: float = 1e-6  # likewise of a pad: what it feels is known less well than its cells' noise says
    # Contacts' residuals, of those that are as told and over the noise as it seems, that are rarer are not explained.
    least_doubted_chance: float = 1e-3
    # Nor are those of noise that seems so many times as large as told: four times is the most that it may be, and where
    # it is twice, it hardly ever seems more than this. Contacts that fit no pose seem to be of noise without end.
    most_noise: float = 3.0
    # The chance that there are no more false contacts than are allowed: of five one, of six to ten two.
    usual_false_contacts: float = 0.8
    # To a belief over time no contact and no pad calls for doubt where noise of so many times the told variance leaves
    # residuals like theirs, at the pose that suits them best, no more rarely than with this chance. The factor is for
    # what the field's kinks add. So of three to ten contacts as told one touch of six to nine calls; of five of which
    # one is 10 to 30 mm off, six of seven do.
    comfortable_chance: float = 0.05
    comfortable_variance: float = 1.2


@dataclasses.dataclass(frozen=True, kw_only=True, slots=True)
class SamplingParams:
    """How the posterior is sampled."""

    samples: int = 128  # poses that are drawn in a round, at the least
    samples_a_tile: int = 4  # likewise
    # Or this share of all before it, as long as rounds make new proposals, each of which weighs all samples.
    growth: float = 0.5
    # What costs so much more than the best is no part of any mode: far off, where contacts are taken for false, there
    # is much room for little. A thousandth of a Gaussian mode lies further up (half of chi-square's, 6 degrees).
    depth: float = 11.2
    truncation: float = 0.4  # no sample weighs more than the mean of all times this power of their number
    # Rounds end when no mode's probability has a larger standard error than this, and the samples are worth as many of
    # the posterior itself. Once they are, and as this share of their number, no round makes new proposals.
    standard_error: float = 0.019
    effective_samples: float = 40.0
    efficiency: float = 0.1
    most_samples: int = 6144  # after which there is no other round
    most_densities: int = 40_000  # of contacts at samples, which is where the time goes; one round at the least
    # Densities that cover the modes, beside one at each: so many times the modes' volume, weighed by their masses, over
    # that of a tile.
    tiles: int = 12
    fewest_tiles: int = 16
    most_tiles: int = 128
    steps: int = 3  # of Gauss and Newton, that bring the tiles to the valley's floor
    # Modes that hold less than this share of the mass by Laplace's approximation are taken at its word; those that hold
    # less than the second share of the best one's are not weighed again either.
    least_sampled_share: float = 1e-4
    least_weighed_share: float = 1e-7
    # Beside these so many, in the first round, for the tails that false contacts leave, of which there are no more.
    tail_samples: int = 48
    least_tail_samples: int = 2  # of these for each
    least_tailed_share: float = 0.02  # of the mass; about modes that hold less the tails are left out
    tile_scatter: float = 2.0  # over Laplace's standard deviations: a valley may have long ends, and bumps on its floor
    tile_reach: float = 1.5  # of a tile, over the way on which a turn's arc is as good as straight
    least_tile_weight: float = 1e-3  # of a tile's samples over the best one's: one that costs more may still be wide
    longest_step: float = 0.1  # toward the valley's floor, over the object's size
    freedom: int = 6  # degrees of freedom of the tiles' Student-t densities: their tails are heavier than a Gaussian's
    # Squared Mahalanobis distance up to which a tile counts; one sample in half a million lies further out.
    farthest: float = 1500.0
    # A mode is wide in a direction when the arc of a turn about the object's middle leaves its tangent by this share of
    # the contacts' standard deviation.
    sagitta: float = 0.25
    held_turn: float = 0.02  # to which a turn about a continuous axis is held where nothing tells one from another, rad

    def round_of(self, tiles: int) -> int:
        """How many samples a round is made of, at the least, that has so many tiles."""
        return max(self.samples, self.samples_a_tile * tiles)


@dataclasses.dataclass(frozen=True, kw_only=True, slots=True)
class MomentParams:
    """What is made of the samples of each mode."""

    pseudo_samples: float = 7.0  # as which Laplace's covariance counts: the fewest that determine one in six dimensions
    # The squared length of a mean of chance, in its standard deviations, is below this in 95 % (chi-square, 6 degrees).
    chance: float = 12.6
    as_good: float = 0.3  # a pose that costs so much more than its mode's minimum explains the touch as well
    tried_shares: tuple[float, ...] = (1.0, 0.75, 0.5, 0.25, 0.0)  # of the way to the mean, the last one none of it
    # By how much the saddle between minima of one mode is at most above the higher side's lowest: half of a Gaussian
    # mode lies further up (half of chi-square's median, 6 degrees). Two equal ones are one up to 5.2 deviations.
    ridge: float = 2.67
    most_joined: int = 24  # modes of which all pairs are evaluated, the most important ones
    # Of minima between modes: so many samples, drawn by their weights, lead to them; within so many standard deviations
    # of a tile two are one; and of so many, the lowest ones, it is asked whether they join any.
    led: int = 64
    apart: float = 0.5
    most_between: int = 40


@dataclasses.dataclass(frozen=True, kw_only=True, slots=True)
class PosteriorParams:
    """All of them."""

    modes: ModeParams = dataclasses.field(default_factory=ModeParams)
    plausibility: PlausibilityParams = dataclasses.field(default_factory=PlausibilityParams)
    sampling: SamplingParams = dataclasses.field(default_factory=SamplingParams)
    moments: MomentParams = dataclasses.field(default_factory=MomentParams)


DEFAULT_PARAMS = PosteriorParams()
