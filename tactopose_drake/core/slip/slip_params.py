"""When an object is taken to slip: one dataclass for each of the tests."""

import dataclasses


@dataclasses.dataclass(kw_only=True, slots=True)
class SlipParams:
    """When the object's surface moves under the fingertips, so that it slips."""

    max_frames: int = 30  # that are remembered
    few_frames: int = 2  # that are compared, so many each, with those before as many others: of a quick slide
    many_frames: int = 5  # and of a slow one
    compared_frames: int = 10  # of those, at the most,
    least_frames: int = 3  # and at the least
    few_threshold: float = 34.0  # of chi-square with six degrees of freedom, where few frames are compared,
    many_threshold: float = 55.0  # and where many are: in that time fingertips roll on over other places
    motion_share: float = 0.1  # of what is unknown of the fingertips' motion, that is new within so short a time
    least_distance: float = 0.0008  # that the contacts have moved on the surface, m
    rough_share: float = 0.3  # of the surface's roughness, that changes as a fingertip rolls on
    noise_gain: float = 0.1  # by which the noise follows that of each frame


@dataclasses.dataclass(kw_only=True, slots=True)
class ForceTestParams:
    """When forces say that the object slips."""

    time: float = 0.025  # s within which
    change: float = 0.3  # forces change by this part of their size where friction gives way,
    noises: float = 2.5  # and by so many times as much as they do in the mean
    settling_time: float = 0.3  # s after a finger has come to touch, until which forces change by that
    least_force: float = 0.05  # N; less is no load,
    least_share: float = 0.05  # nor is less of all fingers' together
    least_fingers: int = 3  # whose ratios of tangential to normal force are alike, where all slide
    alike: float = 0.1  # so far apart, of their mean
    reaching_time: float = 0.3  # s since one of them was not at the limit: fingers may rest there
    limit_share: float = 0.95  # of the largest ratio that was seen while the object was held, from which on one slides
    least_ratio: float = 0.3  # below which nothing slides, whatever was seen
    rise_time: float = 0.5  # s within which ratios have risen
    rise: float = 0.2  # by this, of two fingers at the least, which slide if the ratios then stay
    plateau_time: float = 0.05  # for so long, s,
    plateau: float = 0.04  # within this,
    equal: float = 0.05  # alike up to this part, and no other is larger than they by more,
    growth: float = 0.06  # while all forces change by this part of their size: the load goes on to grow
    gain: float = 0.05  # by which the largest ratio, and what forces change in the mean, follow each frame
    most_ratio: float = 1.0  # beyond which what is seen is no coefficient of friction


@dataclasses.dataclass(kw_only=True, slots=True)
class RigidityTestParams:
    """When fingertips do not move as points of one rigid body, so that one of them slides."""

    time: float = 0.05  # s within which they move
    false_alarm_probability: float = 1e-7  # that noise alone leaves as much unexplained, at each frame
    least_distance: float = 0.0002  # left unexplained of the fingertips' ways, root mean square, m
    way_share: float = 0.05  # of these ways, by which the hand's kinematics err
    velocity_noise: float = 0.002  # of the fingertips' velocities where they touch, before single frames show it, m/s
    least_velocity_noise: float = 0.0002  # and at the least, m/s
    noise_gain: float = 0.1  # by which it follows what each frame shows
