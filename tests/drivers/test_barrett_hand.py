import numpy as np
import pytest

from tactopose_drake.drivers import barrett_protocol as protocol
from tactopose_drake.drivers.barrett_cycle import EncoderState, HandCycle
from tactopose_drake.drivers.barrett_hand import BarrettHand
from tactopose_drake.drivers.barrett_joints import STRAIN_POLYNOMIAL
from tactopose_drake.drivers.barrett_protocol import INITIALIZE, Property, Puck, PuckStatus, ReplyGroup, TactileMode
from tactopose_drake.drivers.barrett_tactile import PASCALS_PER_RAW
from tactopose_drake.drivers.frames import data_frame
from tactopose_drake.drivers.netcanoem import NetCanOemForceTorque
from tactopose_drake.drivers.simulation import faults
from tactopose_drake.drivers.simulation.simulated_barrett_hand import HandState, SimulatedBarrettHand
from tactopose_drake.errors import DeviceError, DeviceTimeoutError, InvalidInputError
from tests.drivers.rigs import (
    HAND_STATE,
    SLOT,
    is_whole,
    make_board,
    make_hand,
    run,
    unread,
    virtual_bus,
)


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


@pytest.mark.parametrize("puck", ["x", None, 10, 15, 11.0])
def test_a_motion_of_what_is_no_puck_is_refused(puck: object) -> None:
    with virtual_bus(make_hand()) as bus, BarrettHand(bus) as hand:
        hand.read()
        with pytest.raises(InvalidInputError, match=r"puck must be an integer from 11 to 14, not .*"):
            hand.initialize(puck)


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
        assert hand.newest.status == "ok"
        np.testing.assert_array_equal(hand.newest.pressures, np.zeros((4, 24)), "the newest is of after the tare")
        np.testing.assert_array_equal(hand.read().pressures, np.zeros((4, 24)))
        more = HAND_STATE.pressures + 2e3
        state[0] = HandState(HAND_STATE.joint_positions, more, HAND_STATE.fingertip_torques)
        unread(hand)
        np.testing.assert_allclose(hand.read().pressures, 2e3, atol=PASCALS_PER_RAW)


class DeafHand(SimulatedBarrettHand):
    """F1 is deaf for a moment: while the hand is tared."""

    def _answer(self, arbitration_id: int, data: bytes, time: float) -> list | None:
        tares = (protocol.encode_get(Property.TACTILE_ID), protocol.encode_set(Property.TACTILE, TactileMode.TARE))
        self.absent = {Puck.F1} if data in tares and self._mode[Puck.F1] is TactileMode.FULL else set()
        return super()._answer(arbitration_id, data, time)


def test_a_tare_that_an_array_does_not_hear_is_an_error() -> None:
    with virtual_bus(DeafHand(lambda time: HAND_STATE, awake=True)) as bus, BarrettHand(bus) as hand:
        hand.read()
        with pytest.raises(DeviceError, match=r"cannot be tared; silent, or failed, are the arrays of F1\.$"):
            hand.tare()
        run(bus, 0.5)
        assert hand.status == "ok", "by its samples alone it could not be told"
        assert np.all(hand.newest.pressures[0] > 0.0)
    simulated = make_hand()
    simulated.absent = {Puck.F2, Puck.SPREAD}
    with virtual_bus(simulated) as bus, BarrettHand(bus) as hand:
        hand.read()
        with pytest.raises(DeviceError, match=r"are the arrays of F2, SPREAD\.$"):
            hand.tare()


@pytest.mark.parametrize(
    "at", [protocol.encode_get(Property.TACTILE_ID), protocol.encode_set(Property.TACTILE, TactileMode.TARE)]
)
def test_a_hand_that_falls_silent_while_it_is_tared_is_an_error(at: bytes) -> None:
    simulated = make_hand()

    def fall_silent(request, replies: list[faults.Reply]) -> list[faults.Reply]:
        if request.data == at:
            simulated.faults = [faults.silence]
            return []
        return replies

    with virtual_bus(simulated) as bus, BarrettHand(bus) as hand:
        hand.read()
        simulated.faults = [fall_silent]
        with pytest.raises(DeviceError, match=r"are the arrays of F1, F2, F3, SPREAD\.$"):
            hand.tare()


def test_a_hand_that_is_silent_before_it_is_tared_is_an_error() -> None:
    simulated = make_hand()
    with virtual_bus(simulated) as bus, BarrettHand(bus) as hand:
        hand.read()
        simulated.faults = [faults.silence]
        with pytest.raises(DeviceTimeoutError, match="was not tared within 2 s; its state: no puck of the hand"):
            hand.tare()


@pytest.mark.parametrize("mode", [TactileMode.FULL, TactileMode.TOP])
def test_saturated_cells_and_overloaded_fingers_are_named(mode: TactileMode) -> None:
    pressures = HAND_STATE.pressures.copy()
    pressures[3, [4, 6]] = 2e5
    pressures[1, 5] = 1.5e5 if mode is TactileMode.FULL else 1.49e5  # high, but not the highest that a reading can tell
    state = HandState(HAND_STATE.joint_positions, pressures, np.array([0.1, 1.6, 0.3]))
    with virtual_bus(SimulatedBarrettHand(lambda time: state, awake=True)) as bus, BarrettHand(bus, mode=mode) as hand:
        assert hand.read().status == "F2: fingertip torque beyond its limit; saturated: palm 4, 6"


@pytest.mark.parametrize(("strain", "is_beyond"), [(666, True), (667, False), (3460, False), (3461, True)])
def test_a_gauge_is_overloaded_beyond_its_limits(strain: int, is_beyond: bool) -> None:
    cycle = HandCycle({(Puck.F1, "torque")}, {(Puck.F1, "torque")}, (STRAIN_POLYNOMIAL,) * 3, EncoderState())
    identifier = protocol.reply_identifier(Puck.F1, ReplyGroup.ORDINARY)
    assert cycle.collect(data_frame(identifier, protocol.encode_value(Property.STRAIN, strain)))
    assert cycle.sample(0.0, ()).status == ("F1: fingertip torque beyond its limit" if is_beyond else "ok")


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
        {"strain_polynomials": [[1.0], [], [1.0]]},
    ],
)
def test_arguments_out_of_range_are_refused(arguments: dict) -> None:
    with virtual_bus() as bus, pytest.raises(InvalidInputError, match=next(iter(arguments))):
        BarrettHand(bus, **arguments)
