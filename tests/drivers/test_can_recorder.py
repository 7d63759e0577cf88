import gc
from pathlib import Path

import can
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tactopose_drake.drivers.barrett_hand import BarrettHand
from tactopose_drake.drivers.can_recorder import CanRecorder
from tactopose_drake.drivers.frames import data_frame
from tactopose_drake.drivers.log_frames import log_frames
from tactopose_drake.drivers.netcanoem import NetCanOemForceTorque
from tactopose_drake.drivers.replay_bus import open_log
from tactopose_drake.drivers.simulation import faults
from tactopose_drake.errors import EndOfLogError, InvalidFileError, InvalidInputError
from tests.drivers.rigs import SLOT, START, make_board, make_hand, run, unread, virtual_bus

BOTH = pytest.mark.parametrize("suffix", [".blf", ".asc"])


def record(path: Path, duration: float = 1.0, *harm: faults.Fault) -> list:
    """A board and a hand for a while; the board's samples."""
    board, hand = make_board(), make_hand()
    with virtual_bus(board, hand) as bus, CanRecorder(path) as recorder:
        recorder.record(bus)
        with NetCanOemForceTorque(bus, calibration_slot=SLOT) as sensor, BarrettHand(bus):
            run(bus, duration / 2)
            board.faults = list(harm)
            run(bus, duration / 2)
            board.faults = []
            run(bus, duration / 2)
            return unread(sensor)


def frames_of(path: Path) -> tuple[list[can.Message], str]:
    """All frames of a log, and how it ends."""
    frames: list[can.Message] = []
    with pytest.raises(EndOfLogError) as end:
        frames.extend(log_frames(path))
    return frames, str(end.value)


def content(frame: can.Message) -> tuple:
    return frame.arbitration_id, bytes(frame.data), frame.is_rx, frame.channel, round(frame.timestamp, 6)


@BOTH
def test_a_log_has_all_frames_of_all_buses(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"log{suffix}"
    heard = []
    with virtual_bus(make_board()) as one, virtual_bus(make_board()) as other, CanRecorder(path) as recorder:
        for channel, bus in enumerate((one, other)):
            recorder.record(bus, channel)
            bus.listen(lambda frame, channel=channel: heard.append((channel, frame.arbitration_id, frame.is_rx)))
            with NetCanOemForceTorque(bus, calibration_slot=SLOT) as sensor:
                sensor.read()
    frames, end = frames_of(path)
    assert [(frame.channel, frame.arbitration_id, frame.is_rx) for frame in frames] == heard
    assert end.endswith(f"ended after {len(frames)} frames.")
    for channel in (0, 1):
        with open_log(path, channel) as bus, NetCanOemForceTorque(bus, calibration_slot=SLOT) as sensor:
            assert sensor.read().status == "ok"


@BOTH
@settings(max_examples=25, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(share=st.floats(0.0, 0.999))
def test_a_log_that_was_cut_off_plays_to_its_last_whole_frame(tmp_path: Path, suffix: str, share: float) -> None:
    whole = tmp_path / f"whole{suffix}"
    if not whole.is_file():
        record(whole)
    frames, _ = frames_of(whole)
    cut = tmp_path / f"cut{suffix}"
    data = whole.read_bytes()
    cut.write_bytes(data[: max(int(share * len(data)), 144)])  # a binary log is none without its header
    left, end = frames_of(cut)
    assert [content(frame) for frame in left] == [content(frame) for frame in frames[: len(left)]]
    assert f"is cut off or damaged after {len(left)} whole frames" in end
    assert len(left) > 0.9 * share * len(frames) - 200


def test_a_text_log_loses_its_last_line_wherever_that_is_cut_off(tmp_path: Path) -> None:
    whole, cut = tmp_path / "whole.asc", tmp_path / "cut.asc"
    record(whole, 0.1)
    frames, _ = frames_of(whole)
    data = whole.read_bytes().removesuffix(b"End TriggerBlock\n")
    last_line = data[:-1].rindex(b"\n") + 1
    for end in range(last_line, len(data)):
        cut.write_bytes(data[:end])
        left, message = frames_of(cut)
        assert len(left) == len(frames) - 1
        assert "cut off" in message


@BOTH
@pytest.mark.parametrize("start", [1_700_000_000.007, 1_700_000_000.0629, 1_700_000_000.5])
def test_the_start_of_a_log_is_kept_to_the_millisecond(tmp_path: Path, suffix: str, start: float) -> None:
    path = tmp_path / f"log{suffix}"
    with CanRecorder(path) as recorder:
        recorder.write(can.Message(arbitration_id=1, data=b"1", timestamp=start), 0)
    (frame,), _ = frames_of(path)
    assert abs(frame.timestamp - start) < 0.0011


@BOTH
def test_frames_before_the_first_get_its_time(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"log{suffix}"
    with CanRecorder(path) as recorder:
        for offset in (0.0, -0.5, 0.25):
            frame = data_frame(1, b"x")
            frame.timestamp = START + offset
            recorder.write(frame, 0)
    frames, _ = frames_of(path)
    np.testing.assert_allclose([frame.timestamp - START for frame in frames], [0.0, 0.0, 0.25], atol=1e-6)


@BOTH
@pytest.mark.parametrize("jump", [5.0, 300.0, 5000.0, -5.0])
def test_a_frame_with_a_stray_time_stamp_is_left_out_and_told(tmp_path: Path, suffix: str, jump: float) -> None:
    path = tmp_path / f"log{suffix}"
    stamps = [START + 6.0 + 0.01 * i + (jump if i == 10 else 0.0) for i in range(20)]
    with CanRecorder(path) as recorder:
        for time in (START, *stamps):
            recorder.write(can.Message(arbitration_id=1, data=b"1", timestamp=time), 0)
    with pytest.raises(EndOfLogError) as end:
        list(log_frames(path))
    assert not end.value.whole
    frames, message = frames_of(path)
    assert "ended after 20 frames. Left out, for time stamps far from their neighbours': frame 12 at 1" in message
    np.testing.assert_allclose([f.timestamp for f in frames], [START, *stamps[:10], *stamps[11:]], atol=0.0011)


def test_a_recorder_that_never_finished_leaves_a_log(tmp_path: Path) -> None:
    path = tmp_path / "log.blf"
    record(path)
    frames, _ = frames_of(path)
    with CanRecorder(tmp_path / "alive.blf") as recorder:
        for frame in frames:
            recorder.write(frame, frame.channel)
        # What is on the disk while the recorder still holds the file.
        (tmp_path / "died.blf").write_bytes((tmp_path / "alive.blf").read_bytes())
    left, end = frames_of(tmp_path / "died.blf")
    assert len(frames) - 300 < len(left) < len(frames)
    assert "cut off" in end
    assert [content(frame) for frame in left] == [content(frame) for frame in frames[: len(left)]]
    # The end of a recorder brings the header up to date as ever.
    assert frames_of(tmp_path / "alive.blf")[1].endswith(f"ended after {len(frames)} frames.")


@pytest.mark.parametrize("fault", [faults.silence, faults.late(0.15), faults.bus_off, faults.extra_frames])
def test_faults_replay_too(tmp_path: Path, fault) -> None:
    path = tmp_path / "log.blf"
    live = record(path, 2.0, fault)
    with open_log(path) as bus, NetCanOemForceTorque(bus, calibration_slot=SLOT) as sensor:
        with pytest.raises(EndOfLogError):
            bus.run_until(np.inf)
        played = unread(sensor)
    live_ok, played_ok = ([sample for sample in samples if sample.status == "ok"] for samples in (live, played))
    assert len(live_ok) > 100
    assert [sample.time for sample in played_ok] == [sample.time for sample in live_ok]
    np.testing.assert_array_equal([s.F_S for s in played_ok], [s.F_S for s in live_ok])


@BOTH
def test_fd_frames_of_others_on_the_bus_pass_by(tmp_path: Path, suffix: str) -> None:
    def beside(_: can.Message, replies: list[faults.Reply]) -> list[faults.Reply]:
        """Each answer comes after two FD frames: of another device, and as long as it and with its identifier."""
        found: list[faults.Reply] = []
        for reply in replies:
            for identifier, length in ((0x123, 64), (reply.frame.arbitration_id, 8)):
                frame = can.Message(
                    arbitration_id=identifier,
                    data=bytes(length),
                    is_fd=True,
                    bitrate_switch=True,
                    is_extended_id=False,
                )
                found.append(faults.Reply(reply.delay, frame))
            found.append(reply)
        return found

    path = tmp_path / f"log{suffix}"
    live = record(path, 1.0, beside)
    assert all(sample.status == "ok" for sample in live)
    frames, _ = frames_of(path)
    assert {(frame.arbitration_id, len(frame.data)) for frame in frames if frame.is_fd} > {(0x123, 64)}
    with open_log(path) as bus, NetCanOemForceTorque(bus, calibration_slot=SLOT) as sensor:
        with pytest.raises(EndOfLogError):
            bus.run_until(np.inf)
        played = unread(sensor)
    np.testing.assert_array_equal([sample.F_S for sample in played], [sample.F_S for sample in live])


@pytest.mark.parametrize("suffix", [".blf", ".asc"])
@pytest.mark.parametrize("length", [9, 15])
def test_a_length_beyond_eight_bytes_does_not_end_a_log(tmp_path: Path, suffix: str, length: int) -> None:
    path = tmp_path / f"log{suffix}"
    with CanRecorder(path) as recorder:
        for k in range(5):
            data = {"dlc": length, "data": bytes(8)} if k == 2 else {"data": bytes([k])}
            recorder.write(can.Message(timestamp=1.0e9 + k, arbitration_id=0x12, is_extended_id=False, **data), 0)
    frames, end = frames_of(path)
    assert [len(frame.data) for frame in frames] == [1, 1, 8, 1, 1]
    assert "ended after 5 frames" in end


def test_commands_of_then_are_passed_over(tmp_path: Path) -> None:
    path = tmp_path / "log.blf"
    with virtual_bus(make_hand()) as bus, CanRecorder(path) as recorder:
        recorder.record(bus)
        with BarrettHand(bus) as hand:
            hand.read()
            hand.tare()
            tared = hand.newest.time
            run(bus, 1.5)
            live = unread(hand)  # since the tare
    with open_log(path) as bus, BarrettHand(bus) as hand:
        while hand.read().time < tared:
            pass
        for sample in live:
            played = hand.read()
            assert played.time == sample.time
            np.testing.assert_array_equal(played.pressures, sample.pressures)
        with pytest.raises(EndOfLogError, match="ended after"):
            hand.read()


def test_a_log_can_be_played_to_a_time(tmp_path: Path) -> None:
    path = tmp_path / "log.blf"
    live = record(path)
    with open_log(path) as bus, NetCanOemForceTorque(bus, calibration_slot=SLOT) as sensor:
        bus.run_until(live[70].time)
        assert sensor.newest is not None
        assert sensor.newest.time == live[70].time


@BOTH
def test_what_is_no_log_is_one_clear_error(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"log{suffix}"
    with pytest.raises(InvalidFileError, match="log"):
        open_log(path)
    record(tmp_path / f"whole{suffix}")
    for content in (b"", bytes(range(256)), (tmp_path / f"whole{suffix}").read_bytes()[:50]):
        path.write_bytes(content)
        with pytest.raises(InvalidFileError, match=r"must be a log|must hold at least one frame"):
            open_log(path)


def test_other_formats_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InvalidInputError, match=r"must be a path that ends in \.blf or \.asc, not .*\.csv"):
        CanRecorder(tmp_path / "log.csv")
    (tmp_path / "log.csv").write_text("")
    with pytest.raises(InvalidFileError, match=r"must end in \.blf or \.asc, not"):
        open_log(tmp_path / "log.csv")
    with pytest.raises(InvalidFileError, match="nowhere"):
        CanRecorder(tmp_path / "nowhere" / "log.blf")


def test_a_log_that_nobody_plays_leaves_no_bus_open(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    record(tmp_path / "log.blf", 0.1)
    bus = open_log(tmp_path / "log.blf")
    del bus
    gc.collect()
    assert not caplog.records, "python-can says that a bus was not shut down"
