"""Parameters of slip detection: one dataclass for each of the tests."""

import dataclasses


@dataclasses.dataclass(kw_only=True, slots=True)
class SlipParams:
    """When the motion of the object's surface under the fingertips counts as a slip."""

    max_frames: int = 30  # number of frames in the history
    few_frames: int = 2  # number of latest frames compared with earlier ones, for a fast slide; as many are skipped
    many_frames: int = 5  # the same for a slow slide
    compared_frames: int = 10  # largest number of earlier frames that these are compared with
    least_frames: int = 3  # least number of earlier frames that these are compared with
    few_threshold: float = 34.0  # chi-square, with six degrees of freedom, above which the few frames reveal a slip
    many_threshold: float = 55.0  # the same for the many: in that time fingertips roll on to other places
    motion_share: float = 0.1  # share of the covariance of the fingertips' motion that is new within so short a time
    least_distance: float = 0.0008  # least displacement of the contacts on the surface, m
    rough_share: float = 0.3  # share of the surface's roughness that changes as a fingertip rolls on
    noise_gain: float = 0.1  # gain with which the noise follows that of each frame


@dataclasses.dataclass(kw_only=True, slots=True)
class ForceTestParams:
    """When forces count as a sign of slip."""

    time: float = 0.025  # time within which forces change when friction gives way, s
    change: float = 0.3  # relative change of forces in this time that is a slip if a finger is at the friction limit
    noises: float = 2.5  # multiple of the forces' usual change that this change must exceed, too
    settling_time: float = 0.3  # time after a finger has touched in which no slip is detected, as forces change, s
    least_force: float = 0.05  # force below which a fingertip carries no load, N
    least_share: float = 0.05  # share of all fingers' force below which a fingertip carries no load
    least_fingers: int = 3  # number of loaded fingers from which on ratios of tangential to normal force are tested
    alike: float = 0.1  # range of these ratios over their mean, below which all fingers may slide together
    reaching_time: float = 0.3  # time in which a finger must have been in its cone, s: fingers may rest at the limit
    limit_share: float = 0.95  # share of the largest ratio while the object was held, from which on a finger may slide
    least_ratio: float = 0.3  # ratio below which nothing slides
    rise_time: float = 0.5  # time within which ratios rise when some of the fingers slide, s
    rise: float = 0.2  # least rise of such a finger's ratio; there must be two of these fingers
    plateau_time: float = 0.05  # time for which their ratios then stay the same, s
    plateau: float = 0.04  # range of a ratio within which it stays the same
    equal: float = 0.05  # relative difference of such ratios that counts as equal; no other ratio may be larger by more
    growth: float = 0.06  # least relative change of forces while the ratios stay the same: the load continues to grow
    gain: float = 0.05  # gain with which the largest ratio, and the mean change of forces, follow each frame
    most_ratio: float = 1.0  # largest ratio that is taken for a coefficient of friction


@dataclasses.dataclass(kw_only=True, slots=True)
class RigidityTestParams:
    """When the fingertips' motion is not that of points on one rigid body, so that one of them slides."""

    time: float = 0.05  # time over which displacements are compared, s
    # Probability at each frame that noise alone, independent from frame to frame, is taken for a slip.
    false_alarm_probability: float = 1e-7
    least_distance: float = 0.0002  # least root mean square of the unexplained displacements, m
    way_share: float = 0.05  # error of the hand's kinematics as a share of the fingertips' paths
    velocity_noise: float = 0.002  # initial standard deviation of the velocities of the touching points, m/s
    # Lower bound on the estimate of this standard deviation, m/s; larger where errors follow those of the frame before.
    least_velocity_noise: float = 0.0002
    noise_gain: float = 0.1  # gain with which the estimate of the noise follows each frame
