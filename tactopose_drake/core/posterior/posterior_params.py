"""Parameters of weighting poses against each other, and how much work goes into it: a dataclass for each part.

They are not options of an estimate: `DEFAULT_PARAMS` applies to all.
"""

import dataclasses


@dataclasses.dataclass(frozen=True, kw_only=True, slots=True)
class ModeParams:
    """Which poses are one mode, what a touch leaves undetermined, and when a mode is the answer."""

    same_sigmas: float = 3.0  # standard deviations within which two poses are one mode
    free_share: float = 0.1  # of the object's size: a direction is free if its standard deviation exceeds this
    most_modes: int = 64  # that are weighted, unless more hypotheses are asked for
    answer_share: float = 0.9  # probability that the first mode needs to be called the answer
    # Fewer contacts and pads leave whole families of poses unless more is known, whatever the first mode's weight.
    fewest_contacts: int = 3


@dataclasses.dataclass(frozen=True, kw_only=True, slots=True)
class PlausibilityParams:
    """When noise alone explains a touch."""

    # Residuals of contacts that noise exceeds with less than this probability are not explained by it.
    least_contact_chance: float = 1e-3
    least_pad_chance: float = 1e-6  # the same for a pad: its measurements are less certain than its cells' noise says
    # The same for the residuals of the contacts that are not outliers, relative to the estimated noise.
    least_doubted_chance: float = 1e-3
    # The largest explained estimate of the noise over the told noise. The true ratio may be up to 4; if it is 2, the
    # estimate hardly ever exceeds this. Contacts that fit no pose seem to have unbounded noise.
    most_noise: float = 3.0
    # An explained touch has at most so many false contacts as are not exceeded with this probability: one of five, two
    # of six to ten.
    usual_false_contacts: float = 0.8
    # A belief over time doubts no contact or pad if noise of `comfortable_variance` times the told variance exceeds the
    # residuals at the best pose with at least this probability. The factor allows for kinks of the distance field. With
    # three to ten contacts as told, one touch in six to nine is doubted; with five of which one is off by 10 to 30 mm,
    # six in seven are.
    comfortable_chance: float = 0.05
    comfortable_variance: float = 1.2


@dataclasses.dataclass(frozen=True, kw_only=True, slots=True)
class SamplingParams:
    """How the posterior is sampled."""

    samples: int = 128  # least number of samples in a round
    samples_a_tile: int = 4  # the same for each tile
    # Poses are drawn from all that a single contact leaves by so many places on the surface that it may touch: one pose
    # for each place, and with a prior for every eighth.
    contact_draws: int = 4096
    # A round that adapts the proposals weights all earlier samples again. So that these are few, it draws at least this
    # share of their number.
    growth: float = 0.5
    # Poses that cost more than the best by this belong to no mode: far off, where contacts are taken for outliers, a
    # low density extends over a large volume. A thousandth of a Gaussian mode lies higher (half of chi-square's, 6
    # degrees).
    most_excess_cost: float = 11.2
    truncation: float = 0.4  # weights are truncated at their mean times this power of their number
    # Rounds end when no mode's probability has a larger standard error than this, and the effective sample size reaches
    # `effective_samples`. Once it does, and is at least the share `efficiency` of all samples, proposals stay fixed.
    standard_error: float = 0.019
    effective_samples: float = 40.0
    efficiency: float = 0.1
    most_samples: int = 6144  # after which there is no further round
    most_densities: int = 40_000  # contacts times samples, which take the time; but at least one round
    # Tiles that cover the modes, besides one at each: this many times the modes' volume, averaged by their masses, over
    # the volume of a tile.
    tiles: int = 12
    fewest_tiles: int = 16
    most_tiles: int = 128
    steps: int = 3  # Gauss-Newton steps that bring the tiles to the valley's floor
    # Modes with less than this share of the mass by Laplace's approximation keep its weight; of those with less than
    # the second share of the best one's, not even the cost is evaluated again.
    least_sampled_share: float = 1e-4
    least_weighed_share: float = 1e-7
    tail_samples: int = 48  # additional samples in the first round for the tails that false contacts leave
    least_tail_samples: int = 2  # of these for each tail
    most_tails: int = 48  # number of tails that are sampled, those that extend farthest
    least_tailed_share: float = 0.02  # of the mass: modes below it get no tails
    tile_scatter: float = 2.0  # over Laplace's standard deviations: a valley may have long ends, and bumps on its floor
    tile_reach: float = 1.5  # width of a tile, over the displacement up to which a rotation's arc is straight
    least_tile_weight: float = 1e-3  # of a tile's samples over the best one's: one that costs more may still be wide
    longest_step: float = 0.1  # of a step toward the valley's floor, over the object's size
    freedom: int = 6  # degrees of freedom of the tiles' Student-t densities: their tails are heavier than a Gaussian's
    # Squared Mahalanobis distance up to which a tile counts; one sample in half a million lies further out.
    farthest: float = 1500.0
    # A rotation about the object's middle counts as straight while its arc leaves the tangent by no more than this
    # share of the contacts' standard deviation.
    sagitta: float = 0.25
    held_turn: float = 0.02  # standard deviation to which turns about a continuous axis are held, if they are free, rad

    def round_of(self, tiles: int) -> int:
        """The least number of samples in a round with this number of tiles."""
        return max(self.samples, self.samples_a_tile * tiles)


@dataclasses.dataclass(frozen=True, kw_only=True, slots=True)
class MomentParams:
    """How the moments of each mode are made from its samples."""

    pseudo_samples: float = 7.0  # sample size of Laplace's covariance: the fewest that determine one in six dimensions
    # Squared Mahalanobis length that the mean of noise stays below with probability 95 % (chi-square, 6 degrees).
    noise_limit: float = 12.6
    as_good: float = 0.3  # a pose whose cost exceeds its mode's minimum by this explains the touch as well
    tried_shares: tuple[float, ...] = (1.0, 0.75, 0.5, 0.25, 0.0)  # of the way to the mean, the last one none of it
    # Largest height of the saddle between minima of one mode above the higher of the sides' lowest minima: a tenth of a
    # Gaussian mode lies higher (half of chi-square's 90 % quantile, 6 degrees). Two equal ones join up to a distance of
    # 6.9 deviations. With half the height, twice as many touches have a saddle so near the limit that the search's seed
    # decides.
    ridge: float = 5.32
    # The same between minima that take different contacts or pads for false: half of a mode lies higher.
    plateau: float = 2.67
    steps_across: int = 4  # that bring a path between minima to the lowest pass
    most_joined: int = 24  # number of modes, the most important ones, of which all pairs are evaluated
    # Minima between modes: the number of samples, drawn by weight, that are refined to minima; how many standard
    # deviations of a tile two minima differ by; and how many, the lowest ones, are tested for joining modes.
    led: int = 64
    apart: float = 0.5
    most_between: int = 40


@dataclasses.dataclass(frozen=True, kw_only=True, slots=True)
class PosteriorParams:
    """All parameters of the posterior."""

    modes: ModeParams = dataclasses.field(default_factory=ModeParams)
    plausibility: PlausibilityParams = dataclasses.field(default_factory=PlausibilityParams)
    sampling: SamplingParams = dataclasses.field(default_factory=SamplingParams)
    moments: MomentParams = dataclasses.field(default_factory=MomentParams)


DEFAULT_PARAMS = PosteriorParams()
