from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from tactopose_drake.drivers import barrett_protocol as protocol
from tactopose_drake.drivers.barrett_cycle import EncoderState
from tactopose_drake.drivers.barrett_hand import BarrettHand
from tactopose_drake.drivers.barrett_protocol import INITIALIZE, Puck, ReplyGroup
from tactopose_drake.drivers.can_recorder import CanRecorder
from tactopose_drake.drivers.frames import data_frame
from tactopose_drake.drivers.replay_bus import open_log
from tactopose_drake.drivers.simulation import faults
from tactopose_drake.drivers.simulation.simulated_barrett_hand import HandState, SimulatedBarrettHand
from tactopose_drake.errors import DeviceTimeoutError, ProtocolError
from tests.drivers.rigs import (
    HAND_STATE,
    has_no_wrong_number,
    is_whole,
    make_hand,
    run,
    unread,
    virtual_bus,
)


def test_an_answer_that_is_contradicted_in_its_round_is_taken_back() -> None:
    simulated = make_hand()

    def contradict(_, replies):
        beyond = protocol.encode_position(1_000_000, 0)
        identifier = protocol.reply_identifier(Puck.F1, ReplyGroup.POSITION)
        noise = [faults.Reply(reply.delay, data_frame(identifier, beyond)) for reply in replies]
        return [part for pair in zip(replies, noise, strict=True) for part in pair]

    with virtual_bus(simulated) as bus, BarrettHand(bus) as hand:
        assert is_whole(hand.read())
        simulated.faults = [contradict]
        sample = hand.read()
        assert sample.status == "F1: motor position must be from -219000 to 219000 counts, not 1000000"
        np.testing.assert_array_equal(np.isnan(sample.joint_positions), np.isin(range(7), [0, 3]))
        assert has_no_wrong_number(sample)


def test_a_position_that_was_cut_to_the_motors_part_is_refused() -> None:
    simulated = make_hand()
    with virtual_bus(simulated) as bus, BarrettHand(bus) as hand:
        assert is_whole(hand.read())
        simulated.faults = [faults.wrong_length(3)]
        sample = hand.read()
        assert "F1: position lacks the joint's encoder" in sample.status
        assert np.isnan(sample.joint_positions[:6]).all()
        assert has_no_wrong_number(sample)


def test_a_finger_without_that_encoder_is_believed_when_it_insists() -> None:
    encoders = EncoderState()
    for _ in range(2):
        with pytest.raises(ProtocolError, match="not yet sure"):
            encoders.check(Puck.F1, None)
    encoders.check(Puck.F1, None)
    encoders.check(Puck.F2, 17)
    for _ in range(5):
        with pytest.raises(ProtocolError, match="which the puck has"):
            encoders.check(Puck.F2, None)


def test_a_finger_that_keeps_silent_is_named_and_the_others_go_on() -> None:
    simulated = make_hand()
    simulated.absent = {Puck.F2}
    with virtual_bus(simulated) as bus, BarrettHand(bus) as hand:
        sample = hand.read()
        assert sample.status == "F2: absent"
        assert has_no_wrong_number(sample)
        np.testing.assert_array_equal(np.isnan(sample.joint_positions), np.isin(range(7), [1, 4]))
        np.testing.assert_array_equal(np.isnan(sample.pressures).all(axis=1), [False, True, False, False])
        simulated.absent = set()
        run(bus, 2.5)
        unread(hand)
        assert is_whole(hand.read())


def test_a_finger_that_is_lost_slows_the_others_only_for_a_moment() -> None:
    simulated = make_hand()
    with virtual_bus(simulated) as bus, BarrettHand(bus) as hand:
        hand.read()
        simulated.absent = {Puck.F3}
        run(bus, 0.5)
        unread(hand)
        run(bus, 2.0)
        samples = unread(hand)
        assert len(samples) > 65  # of 80
        assert all("F3: no position" in sample.status and has_no_wrong_number(sample) for sample in samples)
        assert np.isfinite(samples[-1].pressures[[0, 1, 3]]).all()
        simulated.absent = set()
        run(bus, 2.0)
        unread(hand)
        assert is_whole(hand.read())


def test_a_hand_that_is_not_there() -> None:
    no_answer = pytest.raises(DeviceTimeoutError, match="no puck of the hand answers")
    with virtual_bus() as bus, BarrettHand(bus) as hand, no_answer:
        hand.read()


# Each fault, a part of the state that it ends in, and whether whole samples come meanwhile.
FAULTS = [
    (faults.silence, "no puck of the hand answers", False),
    (faults.missing_frame, "no ", False),
    (faults.out_of_order, "must have the sequence number", False),
    (faults.duplicates, "must have the sequence number", False),
    (faults.extra_frames, "", False),
    (faults.bus_off, "bus is off", False),
    (faults.wrong_length(5), "bytes, not 5", False),
    (faults.late(0.2), "no puck of the hand answers", False),
    (faults.late(0.05), "ok", True),
    (faults.own_frame_echo, "ok", True),
    (faults.error_frames, "ok", True),
]
NAMES = [getattr(fault, "__name__", "") + f"-{status[:12]}" for fault, status, _ in FAULTS]


@pytest.mark.parametrize(("fault", "status", "whole"), FAULTS, ids=NAMES)
def test_a_fault_has_its_status_gives_no_wrong_number_and_passes(fault, status: str, whole: bool) -> None:
    simulated = make_hand()
    with virtual_bus(simulated) as bus, BarrettHand(bus) as hand:
        hand.read()
        simulated.faults = [fault]
        run(bus, 0.05)  # what was on its way
        unread(hand)
        run(bus, 2.0)
        assert status in hand.status
        assert (hand.status == "ok") == whole
        samples = unread(hand)
        assert all(has_no_wrong_number(sample) for sample in samples)
        assert any(is_whole(sample) for sample in samples) == whole
        simulated.faults = []
        run(bus, 4.0)
        assert hand.status == "ok"
        unread(hand)
        assert is_whole(hand.read(0.1))


COUNTS = "position counts from where the puck restarted, until the joint is initialized"
RESTARTED = "; ".join(f"{puck.name}: {COUNTS}" for puck in Puck)


@settings(max_examples=5)
@given(st.floats(0.0, 0.4), st.floats(0.05, 1.0))
def test_a_reboot_is_noticed_and_the_hand_woken_again(wait: float, duration: float) -> None:
    simulated = make_hand()
    with virtual_bus(simulated) as bus, BarrettHand(bus) as hand:
        hand.read()
        run(bus, wait)
        simulated.reboot(duration)
        run(bus, 5.0)
        assert hand.status == RESTARTED
        assert np.isnan(hand.newest.joint_positions).all()
        for puck in Puck:
            hand.initialize(puck)
        run(bus, 0.1)
        assert hand.status == "ok"
        assert all(has_no_wrong_number(sample) for sample in unread(hand))
        assert is_whole(hand.read(0.1))
        assert simulated.moves == [(puck, INITIALIZE) for puck in Puck]


def test_what_counts_from_a_restart_is_no_position_and_a_replay_says_the_same(tmp_path: Path) -> None:
    zero = np.zeros(7)
    simulated = SimulatedBarrettHand(
        lambda time: HandState(HAND_STATE.joint_positions - zero, HAND_STATE.pressures, HAND_STATE.fingertip_torques)
    )
    with virtual_bus(simulated) as bus, CanRecorder(tmp_path / "log.blf") as recorder:
        recorder.record(bus)
        with BarrettHand(bus) as hand:
            assert is_whole(hand.read(2.0)), "woken for the first time, it counts from where it was switched on"
            simulated.reboot(0.3)
            run(bus, 0.1)
            zero[:] = HAND_STATE.joint_positions
            run(bus, 4.0)
            assert all(has_no_wrong_number(sample) for sample in [*hand._unread])
            zero[:] = 0.0
            hand.initialize(Puck.F2)
            run(bus, 0.2)
            assert hand.status == RESTARTED.replace(f"F2: {COUNTS}; ", "")
            np.testing.assert_array_equal(np.isnan(hand.newest.joint_positions), ~np.isin(range(7), [1, 4]))
            live = unread(hand)
    with open_log(tmp_path / "log.blf") as bus, BarrettHand(bus) as hand:
        hand.read(5.0)
        for sample in live:
            played = hand.read(5.0)
            assert played.status == sample.status
            np.testing.assert_array_equal(played.joint_positions, sample.joint_positions)


# The first positions after a search for a silent puck are cut off.
@example(1769)
@settings(max_examples=5)
@given(st.integers(0, 2**32 - 1))
def test_faults_at_random_never_show_as_a_wrong_number(seed: int) -> None:
    generator = np.random.default_rng(seed)
    simulated = make_hand()
    harm = [faults.missing_frame, faults.out_of_order, faults.duplicates, faults.own_frame_echo, faults.error_frames]
    harm += [faults.silence, faults.wrong_length(3), faults.late(0.02), faults.bus_off]
    simulated.faults = [faults.sometimes(fault, 0.01, generator) for fault in harm]
    with virtual_bus(simulated) as bus, BarrettHand(bus) as hand:
        run(bus, 4.0)
        samples = unread(hand)
        assert any(is_whole(sample) for sample in samples)
        assert all(has_no_wrong_number(sample) for sample in samples)
        simulated.faults = []
        run(bus, 4.0)
        assert hand.status == "ok"
