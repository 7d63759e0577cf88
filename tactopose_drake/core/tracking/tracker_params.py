"""Parameters of the pose tracker: what it assumes, and how much it works; one dataclass for each of its parts."""

import dataclasses
import math
from typing import Any

from tactopose_drake.core.evidence.contacts import MOST_SIGMA_POSITION
from tactopose_drake.core.motion.object_motion import MotionNoise
from tactopose_drake.core.parameter_checks import check_numbers
from tactopose_drake.core.posterior.posterior_params import DEFAULT_PARAMS, PlausibilityParams, PosteriorParams
from tactopose_drake.core.slip.slip_params import ForceTestParams, RigidityTestParams, SlipParams
from tactopose_drake.core.validation import instance_of


@dataclasses.dataclass(kw_only=True, slots=True)
class ContactUpdateParams:
    """How modes are updated with contacts: refined to a minimum, then regressed over their spread."""

    max_iterations: int = 12  # most Levenberg-Marquardt steps for each mode
    tolerance: float = 1e-2  # decrease of the cost that is worth a step; noise alone makes the cost vary by about 1
    least_noise_share: float = 0.3  # least share of a contact's standard deviation that is new at each time
    max_displacement: float = 0.008  # rms displacement of the contacts by a sigma point, m: farther off are other faces
    as_good: float = 0.3  # excess of the contacts' cost at the regressed pose over that at the minimum that is accepted
    rounds: int = 2  # number of rounds of regression; the second uses the covariance that the first leaves
    bend_penalty: float = 4.0  # weight of the bends beside a slope against it: the same order as facets and edges
    lasting_normal_share: float = 0.5  # share of the spread of normals about a contact that lasts, as across an edge
    new_normal_share: float = 0.25  # share of it that is new at each time: the contact is measured elsewhere
    roughness_gain: float = 0.2  # gain with which a source's roughness follows the measured one, which is noisy


@dataclasses.dataclass(kw_only=True, slots=True)
class CalibrationScaleParams:
    """Prior and filter of the scale of the hand's calibration errors over what is told of them."""

    doublings: int = 6  # most doublings of the told variances
    halvings: int = 1  # most halvings: a hand may be better than told
    doubling_share: float = 0.85  # ratio of prior probabilities for each further doubling or halving
    apart_share: float = 0.3  # ratio of prior probabilities for each doubling by which points and normals differ
    least_frames: int = 2  # least number of frames in the mean of a contact, before the scale is estimated
    least_share: float = 0.2  # least weight of the last estimate in the running mean


@dataclasses.dataclass(kw_only=True, slots=True)
class WindowParams:
    """Which past touches judge a pose, and how."""

    max_keyframes: int = 5  # most past touches, besides the current one
    max_frames: int = 8  # most frames in the mean of a touch that stays the same
    least_distance: float = 0.004  # distance between a finger's contacts on the object that makes touches different, m
    least_turn_deg: float = 20.0  # the same for the angle between their normals, deg
    max_sigma: float = 0.004  # standard deviation of contacts by the motion since, beyond which a touch is dropped, m
    lasting_share: float = 0.3  # share of the contacts' variances that the calibration makes common to all touches
    slip_probability: float = 0.01  # prior probability that a touch dates from before an unnoticed slip


@dataclasses.dataclass(kw_only=True, slots=True)
class RelocalisationParams:
    """When and where modes are searched for that the belief may lack."""

    period: float = 0.15  # time between two searches while all is well, s
    steady_period: float = 0.3  # the same, once there have been `steady_searches` of the same touch, s
    steady_searches: int = 3  # number of searches of the same touch after which `steady_period` applies
    urgent_period: float = 0.03  # time between two searches while something is wrong or new, s
    starts: int = 120  # most start poses of a search without a prior
    found: int = 12  # most poses that a search ends with
    joined: int = 8  # most of these that are tested for being minima of one valley: there are many paths between them
    led: int = 32  # number of samples that are refined to minima between these
    most_between: int = 16  # most such minima that are tested as well
    samples: int = 96  # least number of importance samples in a round
    most_samples: int = 768  # largest number of importance samples over all rounds
    contact_draws: int = 512  # besides these; see `SamplingParams.contact_draws`
    standard_error: float = 0.03  # of the modes' probabilities, at which sampling ends: searches are averaged
    least_share: float = 0.5  # least weight of the last search in the running mean
    # Mass over that of the best mode, below which the penetration of the hand is not evaluated.
    least_checked_share: float = 0.05
    allowed_depth: float = 0.0015  # allowed penetration, m: fingertips yield where they touch
    depth_sigma: float = 0.001  # standard deviation of the hand's surface, m, if the evidence does not tell it
    least_gain: float = 1.0  # decrease of the cost for which a pose found replaces the filter's pose of the same mode

    @property
    def posterior(self) -> PosteriorParams:
        """Parameters of the posterior with these limits; any noise is plausible, as the belief estimates it."""
        sampling = dataclasses.replace(
            DEFAULT_PARAMS.sampling,
            samples=self.samples,
            most_samples=self.most_samples,
            contact_draws=self.contact_draws,
            standard_error=self.standard_error,
        )
        moments = dataclasses.replace(
            DEFAULT_PARAMS.moments, most_joined=self.joined, led=self.led, most_between=self.most_between
        )
        plausibility = dataclasses.replace(DEFAULT_PARAMS.plausibility, most_noise=math.inf)
        return dataclasses.replace(DEFAULT_PARAMS, sampling=sampling, moments=moments, plausibility=plausibility)


@dataclasses.dataclass(kw_only=True, slots=True)
class VisionParams:
    """What is assumed about poses from vision."""

    correlation_time: float = 0.5  # time after which errors are independent, s; more frequent poses count less
    lasting_share: float = 0.3  # share of a pose's variances that is common to all, for example of the extrinsics
    max_age: float = 1.0  # largest age of a pose that is used, s
    outlier_probability: float = 0.05  # probability that a pose is an outlier, with uniform rotation and translation
    outlier_volume: float = 1.0  # volume in which an outlier's translation is uniform, m^3
    gate: float = 22.5  # NIS of a pose by the earlier ones, beyond which they contradict it (chi-square, 0.1 %)
    remembered: int = 16  # number of times of poses before the last one that are kept to recognise repeated ones


@dataclasses.dataclass(kw_only=True, slots=True)
class MixtureParams:
    """How many modes there are, and how wide they may be."""

    max_modes: int = 8  # most modes kept
    max_updated: int = 3  # most modes that touch updates at each frame; the others wait for a search
    least_updated_share: float = 0.01  # mass over that of the best mode below which a mode is not updated either
    least_share: float = 1e-5  # mass over that of the best mode below which a mode is dropped
    same_sigmas: float = 3.0  # standard deviations, of the found or the believed mode, within which both are one
    max_sigma_translation: float = 0.3  # standard deviation of a translation of which nothing is known, m


@dataclasses.dataclass(kw_only=True, slots=True)
class PoseTrackerParams:
    """What the belief assumes of the hand and of the motion, and how much it works."""

    calibration_position: float = 0.0005  # standard deviation of the constant part of a contact's error, each axis, m
    calibration_normal_deg: float = 2.5  # the same for a rotation of its normal about each axis, deg
    frame_position: float = 0.00075  # standard deviation that is new each time, of contacts with declared covariance, m
    frame_normal_deg: float = 4.3  # the same for their normals, deg
    surface_position: float = 0.0001  # standard deviation of the model's surface from the object's, m
    surface_normal_deg: float = 1.0  # standard deviation of the surface's normals about each axis, deg
    lever_arm: float = 0.25  # distance from O at which rad and m are compared, as a share of the object's size
    settling_time: float = 0.09  # time after a further finger touches or the best mode changes, until it settles, s
    settled_distance: float = 0.01  # displacement of the surface beyond which two best modes are different, m
    answer_probability: float = 0.98  # probability from which on the best mode is the answer; it may stay so for long
    # Standard deviations up to which a mode is an answer, in what the current touch determines: fewer than one in a
    # hundred are then off by 20 mm or 20 degrees.
    answer_distance: float = 0.0075  # largest standard deviation of an answer's translation, m
    answer_turn_deg: float = 7.5  # the same of its rotation, deg
    # Directions in which a touch leaves a larger standard deviation, over the object's size, are not determined by it.
    untold_share: float = 0.3
    slip_time: float = 0.1  # time for which a detected slip is assumed to go on, s
    flicker_time: float = 0.06  # time without contact after which a touch has ended, s: readings may be lost, or weak
    lost_time: float = 0.2  # time without an explanation of the touch after which the pose is lost, s
    unobserved_time: float = 1.0  # time without touch or vision after which the pose is lost, s
    least_touch_chance: float = 1e-6  # p-value below which noise does not explain a touch; tested at each frame
    seed: int = 0  # seed of the searches' random numbers
    noise: MotionNoise = dataclasses.field(default_factory=MotionNoise)
    contact_update: ContactUpdateParams = dataclasses.field(default_factory=ContactUpdateParams)
    calibration_scale: CalibrationScaleParams = dataclasses.field(default_factory=CalibrationScaleParams)
    slip: SlipParams = dataclasses.field(default_factory=SlipParams)
    force_test: ForceTestParams = dataclasses.field(default_factory=ForceTestParams)
    rigidity_test: RigidityTestParams = dataclasses.field(default_factory=RigidityTestParams)
    window: WindowParams = dataclasses.field(default_factory=WindowParams)
    relocalisation: RelocalisationParams = dataclasses.field(default_factory=RelocalisationParams)
    vision: VisionParams = dataclasses.field(default_factory=VisionParams)
    mixture: MixtureParams = dataclasses.field(default_factory=MixtureParams)

    @property
    def plausibility(self) -> PlausibilityParams:
        """When a frame's touch is explained."""
        return PlausibilityParams(least_contact_chance=self.least_touch_chance)

    def validate(self) -> None:
        """Raises InvalidInputError if a number is out of its range."""
        _check_numbers(self)
        for field in dataclasses.fields(self):
            if dataclasses.is_dataclass(getattr(self, field.name)):
                _check_numbers(getattr(self, field.name))


# Fields that are at most 1, besides those whose names end in "_share" or "_probability".
_PARTS_OF_ONE = ("friction_margin", "gain", "noise_gain", "roughness_gain")
_MAY_BE_ZERO = ("seed", "doublings", "halvings")
# Standard deviations of contacts and surfaces, m, at most as large as may be told.
_POSITIONS = ("calibration_position", "frame_position", "surface_position")


def _check_numbers(params: Any) -> None:
    """Raises InvalidInputError unless all floats are positive, and all integers at least one; some may be zero."""
    name, fields = type(params).__name__, dataclasses.fields(params)
    shares = [field.name for field in fields if field.name.endswith(("_share", "_probability"))]
    most = dict.fromkeys((*shares, *_PARTS_OF_ONE), 1.0) | dict.fromkeys(_POSITIONS, MOST_SIGMA_POSITION)
    check_numbers(name, params, may_be_zero=_MAY_BE_ZERO, most=most, units=dict.fromkeys(_POSITIONS, "m"))
    for field in fields:
        if isinstance(field.default_factory, type):
            instance_of(f"{name}.{field.name}", getattr(params, field.name), field.default_factory)
