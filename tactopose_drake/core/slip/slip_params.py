"""Parameters of slip detection: one dataclass for each of the tests."""

import dataclasses


@dataclasses.dataclass(kw_only=True, slots=True)
class SlipParams:
    """When the motion of the object's surface under the fingertips counts as a slip."""

    max_frames: int = 30  # length of the history
    few_frames: int = 2  # latest frames compared with those before, for a fast slide; as many in between are left out
    many_frames: int = 5  # the same for a slow slide
    compared_frames: int = 10  # most earlier frames compared with
    least_frames: int = 3  # least earlier frames compared with
    few_threshold: float = 34.0  # on chi-square with six degrees of freedom, for the few frames
    many_threshold: float = 55.0  # and for the many: in that time fingertips roll on to other places
    motion_share: float = 0.1  # of the covariance of the fingertips' motion that is new within so short a time
    least_distance: float = 0.0008  # that the contacts must have moved on the surface, m
    rough_share: float = 0.3  # of the surface's roughness that changes as a fingertip rolls on
    noise_gain: float = 0.1  # with which the noise follows that of each frame


@dataclasses.dataclass(kw_only=True, slots=True)
class ForceTestParams:
    """When forces count as a sign of slip."""

    time: float = 0.025  # s within which forces change when friction gives way,
    change: float = 0.3  # by at least this share of their size,
    noises: float = 2.5  # and at least this multiple of their mean change
    settling_time: float = 0.3  # s after a finger has touched for which no slip is detected, as forces change by that
    least_force: float = 0.05  # N; a smaller force is no load,
    least_share: float = 0.05  # nor is one below this share of all fingers' together
    least_fingers: int = 3  # whose ratios of tangential to normal force must be alike when all slide,
    alike: float = 0.1  # with a range below this share of their mean,
    reaching_time: float = 0.3  # and of which one was within its cone so lately, s: fingers may rest at the limit
    limit_share: float = 0.95  # of the largest ratio seen while the object was held, from which on a finger may slide
    least_ratio: float = 0.3  # below which nothing slides
    rise_time: float = 0.5  # s within which ratios rise when some fingers slide,
    rise: float = 0.2  # by at least this, for at least two fingers,
    plateau_time: float = 0.05  # and then stay for so long, s,
    plateau: float = 0.04  # within this range,
    equal: float = 0.05  # equal up to this share, with no other ratio larger by more,
    growth: float = 0.06  # while forces change by this share of their size: the load continues to grow
    gain: float = 0.05  # with which the largest ratio, and the mean change of forces, follow each frame
    most_ratio: float = 1.0  # largest ratio that is taken for a coefficient of friction


@dataclasses.dataclass(kw_only=True, slots=True)
class RigidityTestParams:
    """When the fingertips' motion is not that of points on one rigid body, so that one of them slides."""

    time: float = 0.05  # s over which displacements are compared
    false_alarm_probability: float = 1e-7  # of the test on noise alone, at each frame
    least_distance: float = 0.0002  # of the unexplained displacements, root mean square, m
    way_share: float = 0.05  # error of the hand's kinematics as a share of the fingertips' paths
    velocity_noise: float = 0.002  # initial standard deviation of the velocities of the touching points, m/s
    least_velocity_noise: float = 0.0002  # lower bound on its estimate, m/s
    noise_gain: float = 0.1  # with which the estimate follows each frame
