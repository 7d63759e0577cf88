"""The instant of a recording that a calibration takes."""

import math
import weakref

import numpy as np
import pytest

from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.errors import InvalidFileError
from tactopose_drake.hand.encoder_offsets import SLIDE
from tactopose_drake.runs.manifest import Manifest
from tactopose_drake.runs.quiet_instant import QuietInstant, quiet_grasp
from tactopose_drake.runs.recorded_senses import RecordedRun
from tactopose_drake.systems.signals import Signal

TIMES = np.arange(0.0, 4.0, 0.01)
HELD = np.array([0.001, 0.002, 0.0, 0.5, 0.0, -2.0])


def recording(start: float = 0.0) -> RecordedRun:
    """Two fingers close until 1 s, shake, hold still from 2 to 3 s, and let go; a third one never touches."""
    generator = np.random.default_rng(0)
    pressed = (TIMES > 1.0) & (TIMES < 3.5)
    shakes = ((TIMES < 2.0) | (TIMES > 3.0))[:, None]
    joints = 0.3 + 0.05 * shakes * generator.normal(size=(len(TIMES), 2))
    wrench = pressed[:, None] * HELD + 0.0001 * generator.normal(size=(len(TIMES), 6))
    wrench = wrench + 0.2 * pressed[:, None] * shakes * generator.normal(size=(len(TIMES), 6))
    silent = np.tile([0.0, 0.0, 0.0, 0.1, 0.0, 0.0], (len(TIMES), 1))
    signals = {
        "joint_positions": Signal(TIMES.tolist(), list(joints)),
        "wrench_one": Signal(TIMES.tolist(), list(wrench)),
        "wrench_two": Signal(TIMES.tolist(), list(2.0 * wrench)),
        "wrench_three": Signal(TIMES.tolist(), list(silent)),
    }
    return RecordedRun(Manifest(start=start), signals, ("a", "b"), (), (), np.ones(2))


def test_the_quietest_instant_of_the_most_fingers_is_averaged(blob: ObjectModel) -> None:
    grasp = quiet_grasp(recording(start=1000.0), blob, "run")
    assert set(grasp.wrenches) == {"one", "two"}
    np.testing.assert_allclose(grasp.wrenches["one"], HELD, atol=2e-4)
    np.testing.assert_allclose(grasp.wrenches["two"], 2.0 * HELD, atol=4e-4)
    assert grasp.joint_positions == pytest.approx({"a": 0.3, "b": 0.3}, abs=1e-9)
    assert grasp.time is not None
    assert 1002.0 <= grasp.time <= 1003.0


def test_wrenches_that_change_are_not_quiet_and_the_rest_is_averaged(blob: ObjectModel) -> None:
    """The joints are still all the time; only from 2 to 3 s do the wrenches hardly change, to and fro."""
    run = recording(start=1000.0)
    to_and_fro = 0.002 * np.where(np.arange(len(TIMES)) // 2 % 2, 1.0, -1.0)
    is_calm = (TIMES >= 2.0) & (TIMES <= 3.0)
    wrench = HELD + np.where(is_calm, 1.0, 50.0)[:, None] * to_and_fro[:, None] * [0.0, 0.0, 0.0, 0.0, 0.0, 1.0]
    run.signals["joint_positions"] = Signal(TIMES.tolist(), list(np.full((len(TIMES), 2), 0.3)))
    run.signals["wrench_one"] = run.signals["wrench_two"] = Signal(TIMES.tolist(), list(wrench))
    grasp = quiet_grasp(run, blob, "run")
    assert grasp.time is not None
    assert 1002.0 <= grasp.time <= 1003.0
    np.testing.assert_allclose(grasp.wrenches["one"], HELD, atol=0.002 / 14)


def test_a_joint_that_slides_is_as_unquiet_by_a_millimetre_as_another_by_a_degree(blob: ObjectModel) -> None:
    """Until 2 s it goes by 20 mm/s, and from then on it is still, while the wrenches change by a little."""
    still = np.where(TIMES < 2.0, 0.02 * TIMES, 0.04)
    wrench = HELD + np.where(TIMES < 2.0, 0.0, 0.03)[:, None] * np.outer(np.sin(20.0 * TIMES), [0, 0, 0, 0, 0, 1.0])
    signals = {
        "joint_positions": Signal(TIMES.tolist(), list(still[:, None])),
        "wrench_one": Signal(TIMES.tolist(), list(wrench)),
    }
    run = RecordedRun(Manifest(start=1000.0), signals, ("slide",), (), (), np.array([SLIDE]))
    grasp = quiet_grasp(run, blob, "run")
    assert grasp.joint_positions == {"slide": pytest.approx(0.04)}
    assert grasp.time is not None
    assert grasp.time > 1002.0


def test_times_of_a_simulation_count_for_nothing(blob: ObjectModel) -> None:
    assert quiet_grasp(recording(), blob, "run").time is None


def test_what_holds_no_grasp_is_refused(blob: ObjectModel) -> None:
    run = recording()
    run.signals["wrench_one"] = run.signals["wrench_two"] = run.signals["wrench_three"]
    with pytest.raises(InvalidFileError, match=r"run: a finger must press with more than 0\.3 N"):
        quiet_grasp(run, blob, "run")
    del run.signals["joint_positions"]
    with pytest.raises(InvalidFileError, match="must hold joint positions and wrenches"):
        quiet_grasp(run, blob, "run")


def test_an_instant_at_which_a_joint_is_not_known_is_not_quiet(blob: ObjectModel) -> None:
    run = recording()
    joints = run.signals["joint_positions"]
    for time, q in zip(joints.times, joints.values, strict=True):
        q[1] = np.nan if 2.2 < time < 2.7 else q[1]
    assert quiet_grasp(run, blob, "run").joint_positions == pytest.approx({"a": 0.3, "b": 0.3}, abs=0.05)


def quietest(q: np.ndarray, F: np.ndarray) -> int:
    """The first of the quietest 15 samples in which the finger touches, looked for in all: q (t, n), F (t, 6)."""
    best = (-1.0, math.inf, 0)
    for k in range(len(q) - 14):
        window = slice(k, k + 15)
        touches = float(np.all(np.linalg.norm(F[window, 3:], axis=1) > 0.3))
        unrest = np.rad2deg(np.ptp(q[window], axis=0)).sum()
        unrest += (np.ptp(F[window], axis=0) / np.repeat([0.001, 0.05], 3)).sum()
        best = max(best, (touches, unrest, k), key=lambda one: (one[0], -one[1], -one[2]))
    return best[2]


@pytest.mark.parametrize("seed", range(3))
def test_a_long_recording_is_looked_at_as_a_whole(blob: ObjectModel, seed: int) -> None:
    generator = np.random.default_rng(seed)
    times = 0.02 * np.arange(2600)
    calm = generator.uniform(0.5, 1.0, len(times))[:, None]
    calm[985 + 10 * seed : 1000 + 10 * seed] = 0.01  # across the end of what is looked at together
    q = 0.1 + 0.01 * calm * generator.normal(size=(len(times), 2))
    F = HELD + 0.001 * calm * generator.normal(size=(len(times), 6))
    signals = {"joint_positions": Signal(times.tolist(), list(q)), "wrench_one": Signal(times.tolist(), list(F))}
    grasp = quiet_grasp(RecordedRun(Manifest(start=1000.0), signals, ("a", "b"), (), (), np.ones(2)), blob, "run")
    first = quietest(q, F)
    assert first == 985 + 10 * seed
    np.testing.assert_allclose(grasp.wrenches["one"], F[first : first + 15].mean(axis=0), atol=1e-12)
    assert grasp.time == pytest.approx(1000.0 + times[first + 7], abs=1e-6)


def test_of_a_long_recording_little_is_kept(blob: ObjectModel) -> None:
    instant, readings = QuietInstant(np.ones(2)), list[weakref.ref[np.ndarray]]()
    for k in range(30_000):
        for name, value in (("joint_positions", np.full(2, 1e-3 * (k % 7))), ("wrench_one", HELD * (1.0 + 1e-3 * k))):
            readings.append(weakref.ref(value))
            instant.write(name, 0.01 * k, value)
    del value
    assert sum(reading() is not None for reading in readings) < 2500
    assert instant.grasp(blob, "run", ("a", "b"), 0.0).wrenches.keys() == {"one"}


def test_a_time_before_there_are_wrenches_does_not_count(blob: ObjectModel) -> None:
    """However long it is, and however still the joints are in it."""
    instant = QuietInstant(np.ones(2))
    for k in range(1500):
        instant.write("joint_positions", 0.02 * k, np.full(2, 0.5))
    for k in range(1500, 1520):
        instant.write("joint_positions", 0.02 * k, np.full(2, 0.3 + 1e-4 * (k % 2)))
        instant.write("wrench_one", 0.02 * k, HELD)
    grasp = instant.grasp(blob, "run", ("a", "b"), 1000.0)
    assert grasp.joint_positions == pytest.approx({"a": 0.3, "b": 0.3}, abs=1e-4)
    assert grasp.time is not None
    assert 1030.0 <= grasp.time <= 1030.4


def test_a_time_without_changes_is_passed_over(blob: ObjectModel) -> None:
    run = recording(start=1000.0)
    for signal in run.signals.values():
        signal.times[-1] = 1e9
    grasp = quiet_grasp(run, blob, "run")
    assert grasp.time is not None
    # The last readings hold for ages, but nothing touches there.
    assert 1002.0 <= grasp.time <= 1003.0
