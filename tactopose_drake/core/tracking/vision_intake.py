"""What vision says that is new: poses that are late, repeated, frozen, or more frequent than their errors change."""

import dataclasses
import math

import numpy as np

from tactopose_drake.core.tracking.frame_touch import FrameTouch
from tactopose_drake.core.tracking.mode_set import ModeSet
from tactopose_drake.core.tracking.motion_history import MotionHistory
from tactopose_drake.core.tracking.pose_belief import VisionRecord
from tactopose_drake.core.tracking.pose_measurement import PoseMeasurement
from tactopose_drake.core.tracking.tracker_params import PoseTrackerParams

# The density of poses of vision that are errors: one in twenty, turned at random, within a cubic metre.
_LOG_OUTLIER = math.log(0.05 / (8.0 * math.pi**2))
# So many times of poses of vision are remembered.
_REMEMBERED = 16


def take_in_vision(
    record: VisionRecord,
    seen: PoseMeasurement | None,
    history: MotionHistory,
    time: float,
    params: PoseTrackerParams,
) -> tuple[PoseMeasurement | None, VisionRecord]:
    """What vision says that is new, as of now, and the record of it.

    Args:
        record: of what it said before.
        seen: the latest pose from vision.
        history: how the object moved lately, up to now.
        time: now, s.
        params: how long vision counts.
    """
    if seen is None:
        return None, record
    age = time - seen.time
    if age > params.vision_memory:
        return None, dataclasses.replace(record, remark=f"vision is of {age:.1f} s ago")
    if age < 0.0:
        return None, dataclasses.replace(record, remark="vision is of the future")
    if seen.time in record.times:
        return None, record
    times = (*record.times[-_REMEMBERED:], seen.time)
    if record.X_PO is not None and np.array_equal(record.X_PO, seen.X_PO):
        return None, dataclasses.replace(record, times=times, remark="vision is frozen")
    here = history.bring_here(seen)
    record = dataclasses.replace(record, times=times, X_PO=seen.X_PO, remark="")
    if here is None:
        return None, record
    if len(times) > 1:
        # The errors of pictures that follow each other are much the same.
        since = max(min(abs(seen.time - earlier) for earlier in times[:-1]), 1e-3 * params.vision_time)
        here = dataclasses.replace(here, covariance=here.covariance * max(1.0, params.vision_time / since))
    return here, record


def believe_vision(
    modes: ModeSet, touch: FrameTouch, seen: PoseMeasurement, record: VisionRecord, time: float
) -> tuple[ModeSet, VisionRecord, bool]:
    """The modes with what vision says now, the record of it, and whether the best mode doubts it.

    Where there is no mode, and nothing is felt that could say more, vision makes one.
    """
    if len(modes):
        modes, believed = modes.seen(seen, _LOG_OUTLIER)
        if not believed[0]:
            return modes, dataclasses.replace(record, remark="vision is not believed"), True
    elif touch.is_felt:
        return modes, record, False
    else:
        cross = np.zeros((1, 6, 6 * len(touch.sources)))
        flat, even = np.zeros((1, len(touch.sources), 2)), np.zeros(1)
        modes = ModeSet.make(seen.X_PO[None], seen.covariance[None], cross, flat, even, even)
    return modes, dataclasses.replace(record, believed_time=time), False
