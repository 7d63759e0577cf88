import math

import numpy as np
import pytest

from tactopose_drake.errors import InvalidInputError
from tactopose_drake.hand.encoder_offsets import encoder_gains
from tactopose_drake.hand.hand_config import load_hand_config
from tactopose_drake.hand.hand_in_plant import make_hand_plant
from tactopose_drake.systems.joint_encoders import JointEncoders

Q = np.array([0.1, -0.2, 0.3])


def shown(encoders: JointEncoders, q: np.ndarray, noise: np.ndarray | None = None) -> np.ndarray:
    context = encoders.CreateDefaultContext()
    encoders.GetInputPort("joint_positions").FixValue(context, q)
    if noise is not None:
        encoders.GetInputPort("noise").FixValue(context, noise)
    measured: np.ndarray = encoders.GetOutputPort("measured").Eval(context)
    return measured


def test_an_offset_moves_its_joint_and_what_follows_it() -> None:
    gains = np.array([[1.0, 0.0], [0.0, 1.0], [0.0, 0.5]])
    np.testing.assert_allclose(shown(JointEncoders(gains, np.array([0.01, -0.02])), Q) - Q, [0.01, -0.02, -0.01])


def test_noise_is_that_of_each_reading() -> None:
    encoders = JointEncoders(np.eye(3), np.zeros(3), sigma=0.1)
    np.testing.assert_allclose(shown(encoders, Q, np.array([1.0, 0.0, -2.0])) - Q, [0.1, 0.0, -0.2])


def test_a_joint_that_follows_an_encoder_errs_with_it_and_readings_are_of_now() -> None:
    gains = np.array([[1.0, 0.0], [0.0, 1.0], [0.0, -0.5]])
    encoders = JointEncoders(gains, np.zeros(2), sigma=0.1, step=0.02)
    context = encoders.CreateDefaultContext()
    positions, noise, shown = (
        encoders.GetInputPort("joint_positions"),
        encoders.GetInputPort("noise"),
        encoders.GetOutputPort("measured"),
    )
    q = np.array([0.1, -0.2, 0.1])  # the last follows the second
    positions.FixValue(context, q)
    noise.FixValue(context, [0.0, 0.0])
    np.testing.assert_allclose(shown.Eval(context), q, atol=1e-12)
    noise.FixValue(context, [0.4, 1.31])
    np.testing.assert_allclose(shown.Eval(context), [0.14, -0.06, 0.03], atol=1e-12)  # -0.069 is nearest to -0.06
    positions.FixValue(context, q + np.array([0.2, 0.0, 0.0]))
    np.testing.assert_allclose(shown.Eval(context), [0.34, -0.06, 0.03], atol=1e-12)


def test_readings_are_multiples_of_the_step() -> None:
    encoders = JointEncoders(np.diag([1.0, 1.0, 0.5]), np.array([0.001, 0.0, 0.0]), step=0.03)
    measured = shown(encoders, Q)
    np.testing.assert_allclose(measured, [0.09, -0.21, 0.3], atol=1e-12)
    np.testing.assert_array_equal(shown(JointEncoders(np.eye(3), np.zeros(3)), Q), Q)


def test_a_joint_that_is_not_known_stays_so() -> None:
    measured = shown(JointEncoders(np.eye(3), np.full(3, 0.1), step=0.01), np.array([np.nan, 0.0, 0.0]))
    np.testing.assert_array_equal(np.isnan(measured), [True, False, False])


def test_a_hands_encoders_are_on_the_joints_that_follow_no_other() -> None:
    joints, gains = encoder_gains(*make_hand_plant(load_hand_config("shadow_like")))
    assert "FFJ2" in joints
    assert "FFJ1" not in joints
    assert gains.shape == (24, len(joints))
    np.testing.assert_array_equal(gains.sum(axis=0)[joints.index("FFJ2")], 2.0)
    np.testing.assert_array_equal(gains.sum(axis=0)[joints.index("FFJ3")], 1.0)


@pytest.mark.parametrize("wrong", [{"sigma": -1.0}, {"step": math.nan}, {"offsets": np.full(3, 11.0)}])
def test_what_cannot_be_is_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(InvalidInputError, match=next(iter(wrong))):
        JointEncoders(np.eye(3), **{"offsets": np.zeros(3)} | wrong)
