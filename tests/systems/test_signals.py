"""Signals in memory and on disk."""

from pathlib import Path

import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw

from tactopose_drake.errors import InvalidFileError, InvalidInputError
from tactopose_drake.estimation.prior import PosePrior
from tactopose_drake.systems.played_signal import PlayedValue, PlayedVector
from tactopose_drake.systems.signals import UNKNOWN_POSE, Signal, SignalRecorder, read_signals

POSE = RigidTransform(RollPitchYaw(0.1, 0.2, 0.3), [0.01, 0.02, 1 / 3])
VALUES = {
    "vector": [np.array([1 / 3, np.nan, -1e-300]), np.array([np.pi, 2.0, 0.0])],
    "wild": [np.array([1e13 + 1 / 3, -1e300]), np.array([0.0, 1e12])],
    "pose": [RigidTransform(), POSE],
    "unknown pose": [POSE, UNKNOWN_POSE],
    "prior": [None, PosePrior(POSE, sigma_translation=1 / 7, sigma_rotation=0.1)],
}


def write(path: Path | None) -> SignalRecorder:
    with SignalRecorder(path) as recorder:
        for k, time in enumerate((0.0, 0.1 + 0.2)):
            for name, values in VALUES.items():
                recorder.write(name, time, values[k])
                recorder.write(name, time + 0.1, values[k])
    return recorder


def as_bytes(value) -> bytes:
    if isinstance(value, PosePrior):
        return value.mean.tobytes() + np.array([value.sigma_translation, value.sigma_rotation]).tobytes()
    if isinstance(value, RigidTransform):
        return value.GetAsMatrix34().tobytes()
    return b"" if value is None else value.tobytes()


def test_every_kind_comes_back_to_the_last_bit(tmp_path: Path) -> None:
    write(tmp_path / "signals.jsonl")
    signals, cut = read_signals(tmp_path / "signals.jsonl")
    assert cut == ""
    assert signals.keys() == VALUES.keys() == write(None).signals.keys()
    for found in (signals, write(None).signals):
        for name, values in VALUES.items():
            assert found[name].times == [0.0, 0.1 + 0.2]  # and what stays the same is written once
            assert [as_bytes(value) for value in found[name].values] == [as_bytes(value) for value in values]


def test_a_value_stays_until_the_next() -> None:
    signal = Signal([1.0, 2.0], ["first", "second"])
    assert [signal.at(time) for time in (0.9, 1.0, 1.9, 2.0, 9.0)] == [None, "first", "first", "second", "second"]
    assert Signal.constant("always").at(-1e9) == "always"


@pytest.mark.parametrize(
    ("times", "values", "message"),
    [
        ([], [], "times must have 1 or more entries, not 0"),
        ([0.0, 1.0], [np.zeros(2)], "times must be as many as the values, 1, not 2"),
        ([0.0], [np.zeros(2)] * 2, "times must be as many as the values, 2, not 1"),
        ([0.0, 2.0, 1.0], [np.zeros(2)] * 3, r"times must be in ascending order, but times\[2\] is 1 s"),
        ([1.7e9, 1.7e9 - 0.25], [np.zeros(2)] * 2, r"but times\[1\] is 1699999999.75 s"),
        ([np.nan], [np.zeros(2)], r"times must be in ascending order, but times\[0\] is nan s"),
        ([0.0, np.nan, 1.0], [np.zeros(2)] * 3, r"times must be in ascending order, but times\[1\] is nan s"),
        (["now"], [np.zeros(2)], r"times\[0\] must be a number, not 'now'"),
    ],
)
def test_a_signal_that_cannot_be_played_is_refused(times: list, values: list, message: str) -> None:
    with pytest.raises(InvalidInputError, match=message):
        Signal(times, values)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ([np.zeros(2), np.zeros(3)], r"values\[1\] must have the shape \(2,\), not \(3,\)"),
        ([np.zeros(2), None], r"values\[1\].* must (be a number|consist of numbers), not"),
        ([1.0, 2.0], r"values\[0\] must have the shape \(n,\), not \(\)"),
    ],
)
def test_a_vector_is_played_only_of_vectors_of_one_length(values: list, message: str) -> None:
    with pytest.raises(InvalidInputError, match=message):
        PlayedVector(Signal([0.0, 1.0], values))


def test_of_two_values_of_one_time_the_last_one_counts() -> None:
    player = PlayedVector(Signal([0.0, 0.0], [np.zeros(2), np.ones(2)]))
    np.testing.assert_array_equal(player.get_output_port().Eval(player.CreateDefaultContext()), np.ones(2))


def test_before_its_first_value_a_signal_is_unknown_but_a_pose_of_a_port_is_that_value() -> None:
    prior = PosePrior(POSE, sigma_translation=0.01, sigma_rotation=0.1)

    def played(player: PlayedVector | PlayedValue, time: float) -> object:
        context = player.CreateDefaultContext()
        context.SetTime(time)
        return player.get_output_port().Eval(context)

    np.testing.assert_array_equal(played(PlayedVector(Signal([1.0], [np.ones(2)])), 0.9), np.full(2, np.nan))
    player = PlayedValue(Signal([1.0, 2.0], [prior, None]))
    assert [played(player, time) for time in (0.9, 1.0, 2.0)] == [None, prior, None]
    player = PlayedValue(Signal([1.0, 2.0], [POSE, RigidTransform()]))
    assert [as_bytes(played(player, time)) for time in (0.9, 1.0, 2.0)] == [
        as_bytes(pose) for pose in (POSE, POSE, RigidTransform())
    ]


def test_what_is_kept_does_not_follow_the_original() -> None:
    vector, pose = np.zeros(2), RigidTransform()
    with SignalRecorder() as recorder:
        for time in (0.0, 1.0):
            recorder.write("vector", time, vector)
            recorder.write("pose", time, pose)
            vector[0] = 1.0
            pose.set_translation([0.0, 0.0, 1.0])
    np.testing.assert_array_equal(recorder.signals["vector"].values, [[0.0, 0.0], [1.0, 0.0]])
    assert [kept.translation()[2] for kept in recorder.signals["pose"].values] == [0.0, 1.0]


def test_poses_of_a_port_are_kept_as_they_were_at_each_time() -> None:
    """Drake evaluates a port to the pose in its cache, which the next evaluation overwrites."""
    player = PlayedValue(Signal([0.0, 1.0], [RigidTransform([0.1, 0.0, 0.0]), RigidTransform([0.2, 0.0, 0.0])]))
    context = player.CreateDefaultContext()
    with SignalRecorder() as recorder:
        for time in (0.0, 1.0):
            context.SetTime(time)
            recorder.write("pose", time, player.get_output_port().Eval(context))
    assert [kept.translation()[0] for kept in recorder.signals["pose"].values] == [0.1, 0.2]


@pytest.mark.parametrize("poses", [[POSE, RigidTransform(), None], [None, POSE], [POSE, None, POSE]])
def test_a_pose_is_nan_while_it_is_unknown(poses: list) -> None:
    player = PlayedValue(Signal(list(range(len(poses))), poses))
    context = player.CreateDefaultContext()
    for time, pose in [(-1.0, poses[0]), *enumerate(poses)]:
        context.SetTime(time)
        played, expected = player.get_output_port().Eval(context), UNKNOWN_POSE if pose is None else pose
        assert as_bytes(played) == as_bytes(expected)


def test_numbers_of_numpy_and_lists_are_read_again(tmp_path: Path) -> None:
    path = tmp_path / "signals.jsonl"
    with SignalRecorder(path) as recorder:
        for k, time in enumerate(np.arange(0.0, 0.3, 0.1)):
            recorder.write("list", time, [k, np.float32(0.5)])
        recorder.write("single", np.float32(0.5), np.zeros(2, dtype=np.float32))
    signals, _ = read_signals(path)
    assert signals["list"].times == [0.0, 0.1, 0.2]
    np.testing.assert_array_equal(signals["list"].values, [[0.0, 0.5], [1.0, 0.5], [2.0, 0.5]])
    assert signals["single"].times == [0.5]


@pytest.mark.parametrize("on_disk", [True, False])
@pytest.mark.parametrize(
    ("time", "value", "message"),
    [
        (0.5, np.ones(2), "time must be at least the last one, 1 s, not 0.5 s"),
        (np.nan, np.ones(2), "time must be a finite number, not nan"),
        ("now", np.ones(2), "time must be a number, not 'now'"),
        (
            2.0,
            np.zeros(3),
            "value of 'a' must be like the others, or None, but it differs in kind or length from the signal's others",
        ),
        (2.0, RigidTransform(), "value of 'a' must be like the others, or None, but it differs in kind or length"),
        (2.0, np.zeros((2, 2)), r"value of 'a' must have the shape \(n,\), not \(2, 2\)"),
        (2.0, 0.1, "value of 'a' must be a vector, a RigidTransform, a PosePrior or None, not a float"),
    ],
)
def test_what_could_not_be_read_again_is_refused(
    tmp_path: Path, on_disk: bool, time: object, value: object, message: str
) -> None:
    path = tmp_path / "signals.jsonl"
    with SignalRecorder(path if on_disk else None) as recorder:
        recorder.write("a", 1.0, np.zeros(2))
        with pytest.raises(InvalidInputError, match=message):
            recorder.write("a", time, value)
        recorder.write("a", 2.0, None)
        recorder.write("a", 3.0, np.ones(2))
    signals = read_signals(path)[0] if on_disk else recorder.signals
    assert signals["a"].times == [1.0, 2.0, 3.0]


def test_a_file_is_good_to_its_last_whole_line(tmp_path: Path) -> None:
    path = tmp_path / "signals.jsonl"
    write(path)
    whole = path.read_bytes()
    ends = [k + 1 for k, byte in enumerate(whole) if byte == ord("\n")]
    for size in range(len(whole)):
        path.write_bytes(whole[:size])
        signals, cut = read_signals(path)
        lines = sum(end <= size for end in ends)
        assert sum(len(signal.times) for signal in signals.values()) == lines
        assert cut == ("" if size in (0, *ends) else f"{path} is cut off after {lines} whole lines.")


@pytest.mark.parametrize(
    "line",
    ["{", "[1]", '{"time": 0}', '{"time": 0, "name": "a", "colour": 1}', '{"time": "a", "name": "b", "vector": [1]}'],
)
def test_a_line_that_is_no_signal_is_named(tmp_path: Path, line: str) -> None:
    path = tmp_path / "signals.jsonl"
    path.write_text('{"time": 0.0, "name": "a", "vector": [1.0]}\n' + line + "\n")
    with pytest.raises(InvalidFileError, match="line 2 must be a signal"):
        read_signals(path)


@pytest.mark.parametrize("before", ["", '{"time": 1.0, "name": "a", "unknown": true}\n'])
def test_lines_of_one_signal_that_differ_in_kind_are_named_whether_or_not_it_was_unknown(
    tmp_path: Path, before: str
) -> None:
    path = tmp_path / "signals.jsonl"
    for first, second in ((before, ""), ("", before)):
        lines = f'{first}{{"time": 1.0, "name": "a", "vector": [1.0]}}\n{second}'
        path.write_text(f'{lines}{{"time": 1.0, "name": "a", "vector": [1.0, 2.0]}}\n')
        with pytest.raises(InvalidFileError, match=f"line {lines.count('time') + 1} must be a signal .it differs in"):
            read_signals(path)


def test_a_signal_that_was_unknown_at_first_has_one_kind_from_then_on() -> None:
    with SignalRecorder() as recorder:
        recorder.write("a", 0.0, None)
        recorder.write("a", 1.0, np.zeros(2))
        with pytest.raises(InvalidInputError, match="differs in kind or length"):
            recorder.write("a", 2.0, np.zeros(3))


def test_files_that_cannot_be_used_are_named(tmp_path: Path) -> None:
    with pytest.raises(InvalidFileError, match="absent"):
        read_signals(tmp_path / "absent.jsonl")
    with pytest.raises(InvalidFileError, match="cannot be written"):
        SignalRecorder(tmp_path / "absent" / "signals.jsonl")
