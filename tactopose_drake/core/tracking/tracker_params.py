"""What the tracker of a pose assumes, and how much it works: one dataclass for each of its parts."""

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

    max_iterations: int = 12  # steps of Levenberg-Marquardt for each mode, at the most
    tolerance: float = 1e-2  # decrease of the cost that is worth a step; noise alone makes the cost differ by ones
    least_noise_share: float = 0.3  # of a contact's standard deviation that is new at each time, whatever lasts of it
    max_displacement: float = 0.008  # of what is touched by a sigma point, rms, m: farther off are other faces
    as_good: float = 0.3  # cost of the contacts, by which what is regressed may exceed the minimum
    rounds: int = 2  # of regression; the spread of the second is that which the first leaves
    bend_penalty: float = 4.0  # of slopes by the bends beside them: what facets and edges make up is about as large
    lasting_normal_share: float = 0.5  # of the spread of normals about a contact: across an edge all err in one way
    new_normal_share: float = 0.25  # likewise, new at each time: the contact is measured elsewhere
    roughness_gain: float = 0.2  # by which a source's roughness follows the measured one each frame: noise moves that


@dataclasses.dataclass(kw_only=True, slots=True)
class CalibrationScaleParams:
    """How much larger than told the errors of the hand's calibration may be."""

    doublings: int = 6  # of the variances that are told, at the most
    halvings: int = 1  # likewise: a hand may be better than told
    doubling_share: float = 0.85  # of the probability, that each further doubling or halving has
    apart_share: float = 0.3  # likewise, for each doubling that points and normals differ by
    least_frames: int = 2  # of a contact, whose mean tells
    least_share: float = 0.2  # of a mean over estimates, that is by the last one


@dataclasses.dataclass(kw_only=True, slots=True)
class WindowParams:
    """Which touches of the past judge a pose, and how."""

    max_keyframes: int = 5  # beside the touch of now
    max_frames: int = 8  # of which the touch of now is the mean, while it stays the same
    least_distance: float = 0.004  # of a contact on the object from where it was, that tells something new, m
    least_turn_deg: float = 20.0  # likewise of its normal, deg
    max_sigma: float = 0.004  # of the motion since, at the contacts, beyond which a touch tells nothing, m
    lasting_share: float = 0.3  # of the contacts' variances, that is of the hand's calibration
    slip_probability: float = 0.01  # prior, that a touch is of before a slip that nobody noticed


@dataclasses.dataclass(kw_only=True, slots=True)
class RelocalisationParams:
    """When and where modes are searched for that the belief lacks."""

    period: float = 0.15  # s between two searches, while all is well
    steady_period: float = 0.3  # likewise, once
    steady_searches: int = 3  # so many have told of the same touch
    urgent_period: float = 0.03  # s between two searches, while it is not
    starts: int = 120  # poses with which a search without a prior begins, at the most
    found: int = 12  # poses that it ends with, at the most
    joined: int = 8  # of these, of which it is asked which are minima of one valley, at the most: ways are many
    led: int = 32  # samples that lead to minima between these,
    most_between: int = 16  # of which so many are asked as well, at the most
    samples: int = 96  # by which these are weighed at the least, in a round
    most_samples: int = 768  # and at the most, in several,
    standard_error: float = 0.03  # until no mode's probability is less sure: some searches are the mean's
    least_share: float = 0.5  # of a mean over searches, that is by the last one
    # Of the mass of the best mode; how deep the object would reach into the hand is not asked of less.
    least_checked_share: float = 0.05
    allowed_depth: float = 0.0015  # m, by which it may: fingertips give way where they touch
    depth_sigma: float = 0.001  # to which the hand's surface is known, m, where the evidence does not say it
    least_gain: float = 1.0  # of the cost, for which what is found takes the place of the filter's mode that it is

    @property
    def posterior(self) -> PosteriorParams:
        """Of the posterior of which so many samples are drawn; its noise may be any, for the belief learns that."""
        sampling = dataclasses.replace(
            DEFAULT_PARAMS.sampling,
            samples=self.samples,
            most_samples=self.most_samples,
            standard_error=self.standard_error,
        )
        moments = dataclasses.replace(
            DEFAULT_PARAMS.moments, most_joined=self.joined, led=self.led, most_between=self.most_between
        )
        plausibility = dataclasses.replace(DEFAULT_PARAMS.plausibility, most_noise=math.inf)
        return dataclasses.replace(DEFAULT_PARAMS, sampling=sampling, moments=moments, plausibility=plausibility)


@dataclasses.dataclass(kw_only=True, slots=True)
class VisionParams:
    """What is assumed of poses from vision."""

    correlation_time: float = 0.5  # s after which the error is a new one; more frequent poses count less
    lasting_share: float = 0.3  # of a pose's variances, that all have in common: of extrinsics, say
    max_age: float = 1.0  # s; what vision saw earlier is of no use
    outlier_probability: float = 0.05  # that a pose is an error, turned at random,
    outlier_volume: float = 1.0  # and anywhere within so many m^3
    gate: float = 22.5  # NIS of a pose by the earlier ones, beyond which they contradict it (chi-square, 0.1 %)
    remembered: int = 16  # times of poses before the last one's, by which repeated ones are known


@dataclasses.dataclass(kw_only=True, slots=True)
class MixtureParams:
    """How many modes there are, and how wide they may be."""

    max_modes: int = 8  # kept at the most
    max_updated: int = 3  # that touch updates at each frame, at the most; the others wait for a search
    least_updated_share: float = 0.01  # of the mass of the best mode; of less the same is true
    least_share: float = 1e-5  # of the mass of the best mode; less is dropped
    same_sigmas: float = 3.0  # standard deviations of a mode found, or of one believed, within which both are one
    max_sigma_translation: float = 0.3  # m; of a translation with this standard deviation nothing is known


@dataclasses.dataclass(kw_only=True, slots=True)
class PoseTrackerParams:
    """What the belief assumes of the hand and of the motion, and how much it works."""

    calibration_position: float = 0.0005  # the part of a contact's error that never changes, of each coordinate, m
    calibration_normal_deg: float = 2.5  # likewise of its normal about each axis, deg
    frame_position: float = 0.00075  # of contacts whose covariance a hand declares, the part that is new each time, m
    frame_normal_deg: float = 4.3  # likewise of their normals, deg
    surface_position: float = 0.0001  # how far the model's surface is from the object's, m
    surface_normal_deg: float = 1.0  # how far its normals are about each axis, deg
    lever_arm: float = 0.25  # of the object's size: so far from O a turn moves the surface, by which m and rad compare
    settling_time: float = 0.09  # s after a finger has come to touch, or the best mode has become another, until it is
    settled_distance: float = 0.01  # of the surface between two best modes that are not the same, m
    answer_probability: float = 0.98  # of the best mode, from which on it is the answer; it may stay so for long
    # Standard deviations up to which it is one, where the touch of now tells of it: fewer than one in a hundred are off
    # by 20 mm or 20 degrees.
    answer_distance: float = 0.0075  # m
    answer_turn_deg: float = 7.5  # deg
    untold_share: float = 0.3  # of the object's size: the touch of now tells nothing where it is no better known
    slip_time: float = 0.1  # s for which a slip that was found is taken to go on
    flicker_time: float = 0.06  # s without touch, within which it has not ended: readings are lost, and may be weak
    lost_time: float = 0.2  # s without an explanation of the touch, after which the pose is lost
    unobserved_time: float = 1.0  # s without touch or vision, after which the pose is lost
    least_touch_chance: float = 1e-6  # with which noise alone leaves residuals as large; it is asked at each frame
    seed: int = 0  # of the searches' random numbers
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


# What has such a name is a part of one.
_PARTS_OF_ONE = ("_share", "_probability", "_margin", "gain")
_NOT_PARTS = ("least_gain",)  # of a cost
_MAY_BE_ZERO = ("seed", "doublings", "halvings")
# Of contacts and surfaces, as much as may be told of them, m.
_POSITIONS = ("calibration_position", "frame_position", "surface_position")


def _check_numbers(params: Any) -> None:
    """Raises InvalidInputError unless all floats are positive, and all integers at least one; some may be zero."""
    name, fields = type(params).__name__, dataclasses.fields(params)
    parts = [field.name for field in fields if field.name.endswith(_PARTS_OF_ONE) and field.name not in _NOT_PARTS]
    most = dict.fromkeys(parts, 1.0) | dict.fromkeys(_POSITIONS, MOST_SIGMA_POSITION)
    check_numbers(name, params, may_be_zero=_MAY_BE_ZERO, most=most, units=dict.fromkeys(_POSITIONS, "m"))
    for field in fields:
        if isinstance(field.default_factory, type):
            instance_of(f"{name}.{field.name}", getattr(params, field.name), field.default_factory)
