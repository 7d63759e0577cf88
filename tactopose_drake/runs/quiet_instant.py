"""Extracts a grasp for calibration from a recording: the readings while the hand held the object most quietly."""

import math

import numpy as np

from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import FloatArray
from tactopose_drake.errors import InvalidFileError
from tactopose_drake.hand.recorded_grasps import RecordedGrasp
from tactopose_drake.runs.recorded_senses import RecordedRun
from tactopose_drake.systems.signals import Signal

_WRENCH = "wrench_"
_STEP = 0.02  # s between samples of the recording
_A_GAP = 1e6  # penalty of an unknown joint, in degrees of motion: more than any motion
_WINDOW = 15  # number of samples over which readings are averaged
_TOUCHES = 0.3  # least force of a touch, N; less may be a bias
# Changes of a wrench, N m and N, that count as much as a joint's motion by 1 degree, or by 1 mm if prismatic.
_STILL = np.repeat([0.001, 0.05], 3)


def quiet_grasp(run: RecordedRun, model: ObjectModel, name: str) -> RecordedGrasp:
    """The mean readings of the quietest 0.3 s in which the largest number of fingers touch.

    Args:
        run: the recording.
        model: the object in it.
        name: name of the recording, for messages.

    Raises:
        InvalidFileError: if it has no joint positions, is shorter than 0.3 s, or nothing touches the object in it.
    """
    wrenches = {key.removeprefix(_WRENCH): signal for key, signal in run.signals.items() if key.startswith(_WRENCH)}
    if "joint_positions" not in run.signals or not wrenches:
        raise InvalidFileError(f"{name} must hold joint positions and wrenches, but lacks one of them.")
    signals = [run.signals["joint_positions"], *wrenches.values()]
    first, last = max(signal.times[0] for signal in signals), max(signal.times[-1] for signal in signals)
    times = np.arange(first, last + 1e-9, _STEP)
    if len(times) < _WINDOW:
        raise InvalidFileError(f"{name} must have all readings for at least 0.3 s, not for {last - first:.2f} s.")
    q = _sampled(signals[0], times)
    F = np.stack([_sampled(signal, times) for signal in wrenches.values()], axis=1)  # (t, fingers, 6)
    windows = np.arange(len(times) - _WINDOW + 1)[:, None] + np.arange(_WINDOW)
    touching = np.all(np.linalg.norm(F[windows, :, 3:], axis=3) > _TOUCHES, axis=1)
    count = touching.sum(axis=1)
    if not count.any():
        raise InvalidFileError(f"{name}: a finger must press with more than {_TOUCHES} N for 0.3 s, but none does.")
    # Avoid windows in which a joint is unknown that is known at other times.
    gaps = np.isnan(q[windows]).any(axis=1)[:, np.isfinite(q).any(axis=0)].sum(axis=1)
    unrest = np.nansum(np.ptp(q[windows], axis=1) / run.units, axis=1) / math.radians(1.0) + _A_GAP * gaps
    unrest = unrest + np.nansum(np.ptp(F[windows], axis=1) / _STILL, axis=(1, 2))
    best = int(np.argmin(np.where(count == count.max(), unrest, np.inf)))
    rows = windows[best]
    felt = F[rows].mean(axis=0)
    readings = q[rows].mean(axis=0)
    joints = {joint: float(value) for joint, value in zip(run.joints, readings, strict=True) if np.isfinite(value)}
    fingers = {finger: felt[k] for k, finger in enumerate(wrenches) if touching[best, k]}
    # Times of simulations start at 0 in each run, and are not comparable.
    time = run.manifest.start + float(times[rows].mean()) if run.manifest.start > 0.0 else None
    return RecordedGrasp(model, joints, fingers, time=time, name=name)


def _sampled(signal: Signal, times: FloatArray) -> FloatArray:
    """The signal's values at the given times, shape (t, size)."""
    places = np.clip(np.searchsorted(signal.times, times, side="right") - 1, 0, None)
    return np.array([signal.values[i] for i in places], dtype=np.float64)
