import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from tactopose_drake.drivers import barrett_protocol as protocol
from tactopose_drake.drivers.barrett_cycle import HandSample, JointEncoders
from tactopose_drake.drivers.barrett_hand import BarrettHand
from tactopose_drake.drivers.barrett_protocol import INITIALIZE, Property, Puck, PuckStatus, ReplyGroup, TactileMode
from tactopose_drake.drivers.barrett_tactile import PASCALS_PER_RAW
from tactopose_drake.drivers.frames import data_frame
from tactopose_drake.drivers.netcanoem import NetCanOemForceTorque
from tactopose_drake.drivers.simulation import faults
from tactopose_drake.drivers.simulation.simulated_barrett_hand import HandState, SimulatedBarrettHand
from tactopose_drake.errors import DeviceError, DeviceTimeoutError, InvalidInputError, ProtocolError
from tests.drivers.rigs import HAND_STATE, SLOT, make_board, make_hand, run, unread, virtual_bus


def has_no_wrong_number(sample: HandSample) -> bool:
    """Every number is the true one, or NaN."""
    wrong = [
        np.abs(sample.joint_positions - HAND_STATE.joint_positions) > 1e-4,
        np.abs(sample.pressures - HAND_STATE.pressures) > 0.51 * PASCALS_PER_RAW,
        np.abs(sample.fingertip_torques - HAND_STATE.fingertip_torques) > 2e-3,
    ]
    return not any(part.any() for part in wrong)


def is_whole(sample: HandSample) -> bool:
    parts = [sample.joint_positions, sample.pressures, sample.fingertip_torques]
    return has_no_wrong_number(sample) and all(np.isfinite(part).all() for part in parts)


def test_reads_everything_in_si_units() -> None:
    with virtual_bus(make_hand()) as bus, BarrettHand(bus) as hand:
        sample = hand.read()
    assert sample.status == "ok"
    assert is_whole(sample)


def test_wakes_the_hand_in_silence_and_never_moves_it() -> None:
    simulated = make_hand(awake=False)
    with virtual_bus(simulated, make_board()) as bus, NetCanOemForceTorque(bus, calibration_slot=SLOT) as sensor:
        sensor.read()
        with BarrettHand(bus) as hand:
            run(bus, 0.5)
            assert "waking up" in hand.status
            assert is_whole(hand.read(2.0))
            assert hand.pucks == dict.fromkeys(Puck, PuckStatus.READY)
        assert not simulated.disturbed
        assert simulated.moves == []
        unread(sensor)
        assert sensor.read(0.1).status == "ok"


def test_traffic_while_the_hand_wakes_up_would_be_noticed() -> None:
    simulated = make_hand(awake=False)
    with virtual_bus(simulated, make_board()) as bus, BarrettHand(bus) as hand:
        bus.hush = lambda *_: None
        with NetCanOemForceTorque(bus, calibration_slot=SLOT):
            run(bus, 0.5)
        assert "waking up" in hand.status
    assert simulated.disturbed


def test_only_harmless_properties_are_written_unless_a_motion_is_asked_for() -> None:
    written = set()

    def note(frame) -> None:
        if not frame.is_rx and frame.data[0] & 0x80:
            written.add(Property(frame.data[0] & 0x7F))

    simulated = make_hand(awake=False)
    with virtual_bus(simulated) as bus:
        bus.listen(note)
        with BarrettHand(bus) as hand:
            hand.read(2.0)
            hand.tare()
            simulated.reboot(0.3)
            run(bus, 4.0)
            assert written == {Property.STATUS, Property.TACTILE}
            hand.initialize(Puck.F2)
            run(bus, 0.1)
            assert simulated.moves == [(Puck.F2, INITIALIZE)]


def test_a_motion_is_never_sent_later_than_it_was_asked_for() -> None:
    simulated = make_hand()
    with virtual_bus(simulated) as bus, BarrettHand(bus) as hand:
        with pytest.raises(DeviceError, match="cannot be commanded"):
            hand.initialize(Puck.F1)
        hand.read()
        simulated.faults = [faults.silence]
        hand.initialize(Puck.F1)  # would go out after the present round
        run(bus, 1.0)
        with pytest.raises(DeviceError, match="no puck of the hand answers"):
            hand.initialize(Puck.F2)
        simulated.faults = []
        run(bus, 3.0)
        assert hand.status == "ok"
    assert simulated.moves == []


def test_short_readings_give_the_ten_highest_cells() -> None:
    with virtual_bus(make_hand()) as bus, BarrettHand(bus, mode=TactileMode.TOP) as hand:
        sample = hand.read()
    assert sample.status == "ok"
    for pressures, truth in zip(sample.pressures, HAND_STATE.pressures, strict=True):
        known = np.isfinite(pressures)
        assert known.sum() == 10
        assert truth[known].min() >= truth[~known].max()
        np.testing.assert_allclose(pressures[known], truth[known], atol=1e4)


def test_a_tare_makes_the_present_pressures_the_zero() -> None:
    state = [HAND_STATE]
    with virtual_bus(SimulatedBarrettHand(lambda time: state[0], awake=True)) as bus, BarrettHand(bus) as hand:
        hand.read()
        hand.tare()
        run(bus, 1.0)
        unread(hand)
        np.testing.assert_array_equal(hand.read().pressures, np.zeros((4, 24)))
        more = HAND_STATE.pressures + 2e3
        state[0] = HandState(HAND_STATE.joint_positions, more, HAND_STATE.fingertip_torques)
        unread(hand)
        np.testing.assert_allclose(hand.read().pressures, 2e3, atol=PASCALS_PER_RAW)


def test_saturated_cells_and_overloaded_fingers_are_named() -> None:
    pressures = HAND_STATE.pressures.copy()
    pressures[3, [4, 6]] = 2e5
    state = HandState(HAND_STATE.joint_positions, pressures, np.array([0.1, 1.6, 0.3]))
    with virtual_bus(SimulatedBarrettHand(lambda time: state, awake=True)) as bus, BarrettHand(bus) as hand:
        assert hand.read().status == "F2: fingertip torque beyond its limit; saturated: palm 4, 6"


def test_strain_gauges_have_their_own_calibrations() -> None:
    with virtual_bus(make_hand()) as bus:
        linear = [(0.0, 0.0, 1e-3, 0.0)] * 3
        with BarrettHand(bus, strain_polynomials=linear) as hand:
            strains = 1e3 * hand.read().fingertip_torques
    np.testing.assert_allclose(strains, np.round(strains), atol=1e-9)
    assert np.all(np.diff(strains) > 0)


@pytest.mark.parametrize(
    "arguments",
    [
        {"mode": TactileMode.OFF},
        {"mode": TactileMode.TARE},
        {"period": 0.0},
        {"timeout": -1.0},
        {"strain_polynomials": [[1.0]] * 2},
        {"strain_polynomials": [[1.0], [np.nan], [1.0]]},
    ],
)
def test_arguments_out_of_range_are_refused(arguments: dict) -> None:
    with virtual_bus() as bus, pytest.raises(InvalidInputError, match=next(iter(arguments))):
        BarrettHand(bus, **arguments)


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
        assert sample.status == "F1: motor position: is 1000000 counts; allowed are -219000 to 219000."
        np.testing.assert_array_equal(np.isnan(sample.joint_positions), np.isin(range(7), [0, 3]))
        assert has_no_wrong_number(sample)


def test_a_position_that_was_cut_to_the_motors_part_is_refused() -> None:
    simulated = make_hand()
    with virtual_bus(simulated) as bus, BarrettHand(bus) as hand:
        assert is_whole(hand.read())
        simulated.faults = [faults.wrong_length(3)]
        sample = hand.read()
        assert "F1: position: lacks the joint's encoder" in sample.status
        assert np.isnan(sample.joint_positions[:6]).all()
        assert has_no_wrong_number(sample)


def test_a_finger_without_that_encoder_is_believed_when_it_insists() -> None:
    encoders = JointEncoders()
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
    (faults.out_of_order, "expected was", False),
    (faults.duplicates, "expected was", False),
    (faults.extra_frames, "", False),
    (faults.bus_off, "bus: is off", False),
    (faults.wrong_length(5), "has 5 bytes", False),
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


@settings(max_examples=5)
@given(st.floats(0.0, 0.4), st.floats(0.05, 1.0))
def test_a_reboot_is_noticed_and_the_hand_woken_again(wait: float, duration: float) -> None:
    simulated = make_hand()
    with virtual_bus(simulated) as bus, BarrettHand(bus) as hand:
        hand.read()
        run(bus, wait)
        simulated.reboot(duration)
        run(bus, 5.0)
        assert hand.status == "ok"
        assert all(has_no_wrong_number(sample) for sample in unread(hand))
        assert is_whole(hand.read(0.1))
        assert simulated.moves == []


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
