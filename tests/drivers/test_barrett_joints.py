import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactopose_drake.drivers import barrett_joints as joints
from tactopose_drake.errors import ProtocolError

angle = st.floats(-0.2, math.radians(150))


@given(angle, st.floats(-0.1, math.radians(48)))
def test_finger_angles_survive_the_encoders(inner: float, outer: float) -> None:
    motor, joint = joints.finger_counts(inner, outer)
    got_inner, got_outer = joints.finger_angles(motor, joint)
    step = 2 * math.pi / 4096 / 50  # of the coarser encoder
    assert got_inner == pytest.approx(inner, abs=step)
    assert got_outer == pytest.approx(outer, abs=2 * step)


@given(st.floats(-math.pi, math.pi))
def test_spread_angles_survive_the_encoder(spread: float) -> None:
    assert joints.spread_angle(joints.spread_counts(spread)) == pytest.approx(spread, abs=math.pi / 35840)


def test_the_range_of_a_finger() -> None:
    inner, outer = joints.finger_angles(199_111, None)
    assert math.degrees(inner) == pytest.approx(140, abs=0.01)
    assert outer == inner / 3
    # While the clutch is closed, the inner link's own encoder says the same as the motor's.
    assert joints.finger_angles(199_111, round(199_111 * 50 / 125)) == pytest.approx((inner, outer), abs=1e-4)


@given(st.integers(-(2**21), 2**21), st.none() | st.integers(-(2**21), 2**21))
def test_counts_beyond_the_joints_are_refused(motor: int, joint: int | None) -> None:
    for angles in (lambda: joints.finger_angles(motor, joint), lambda: (joints.spread_angle(motor),)):
        try:
            values = angles()
        except ProtocolError:
            continue
        assert all(abs(value) < 2 * math.pi for value in values)


@given(st.integers(-(2**15), 2**15 - 1))
def test_strains_outside_of_twelve_bits_are_refused(strain: int) -> None:
    if 0 <= strain <= 4095:
        assert -3 < joints.fingertip_torque(strain) < 3
    else:
        with pytest.raises(ProtocolError, match="strain"):
            joints.fingertip_torque(strain)


@given(st.floats(-1.1, 1.1))
def test_torques_survive_the_gauge(torque: float) -> None:
    assert joints.fingertip_torque(joints.strain_of(torque)) == pytest.approx(torque, abs=2e-3)


def test_a_gauge_at_rest() -> None:
    assert abs(joints.fingertip_torque(2000)) < 0.06
    assert joints.fingertip_torque(3460) == pytest.approx(1.14, abs=0.15)
