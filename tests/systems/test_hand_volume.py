import numpy as np
import pytest
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.framework import Context, DiagramBuilder

from tactopose_drake.errors import PortTypeError
from tactopose_drake.hand.contact_uncertainty import ContactUncertainty
from tactopose_drake.hand.geometry import BodySpheres, HandGeometry
from tactopose_drake.hand.hand_config import HandConfig, HandUncertainty, load_hand_config
from tactopose_drake.hand.hand_in_plant import add_hand, make_hand_plant
from tactopose_drake.systems.hand_volume import HandVolume

POSITIONS = np.linspace(0.05, 0.6, 24)


@pytest.fixture(scope="module")
def config() -> HandConfig:
    return load_hand_config("shadow_like")


@pytest.fixture(scope="module")
def spheres(config: HandConfig) -> BodySpheres:
    return BodySpheres.of_hand(config)


@pytest.fixture
def system(config: HandConfig, spheres: BodySpheres) -> HandVolume:
    system = HandVolume(*make_hand_plant(config), spheres)
    system.set_name("hand_volume")
    return system


def make_context(system: HandVolume, positions: np.ndarray = POSITIONS, untouched: object = None) -> Context:
    context = system.CreateDefaultContext()
    system.GetInputPort("joint_positions").FixValue(context, positions)
    if untouched is not None:
        system.GetInputPort("fingers_untouched").FixValue(context, AbstractValue.Make(untouched))
    return context


def by_the_plant(config: HandConfig, positions: np.ndarray) -> HandGeometry:
    """In a diagram of its own, with the base elsewhere."""
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlantSceneGraph(builder, time_step=0.001)
    palm_frame = add_hand(plant, config, RigidTransform([1.0, 2.0, 3.0])).palm_frame
    plant.Finalize()
    context = plant.GetMyMutableContextFromRoot(builder.Build().CreateDefaultContext())
    plant.SetPositions(context, positions)
    return HandGeometry.from_plant(plant, context, palm_frame)


def test_a_hand_that_declares_errors_is_as_far_off(config: HandConfig, spheres: BodySpheres) -> None:
    plant, hand = make_hand_plant(config)
    sigmas = []
    for degrees in (None, 1.0, 3.0):
        errors = None if degrees is None else HandUncertainty(encoder_offset_deg=degrees)
        uncertainty = None if errors is None else ContactUncertainty(plant, hand, errors)
        context = make_context(system := HandVolume(plant, hand, spheres, uncertainty), untouched=("thumb",))
        sigmas.append(system.GetOutputPort("hand").Eval(context).sigma)
        assert system.GetOutputPort("untouched").Eval(context).sigma == sigmas[-1]
    assert sigmas[0] == 0.001
    assert 0.0015 < sigmas[1] < 0.004
    assert 2.0 * sigmas[1] < sigmas[2] < 3.0 * sigmas[1]


def test_the_spheres_are_where_the_joints_put_them(system: HandVolume, config: HandConfig) -> None:
    context = make_context(system)
    for positions in (POSITIONS, np.zeros(24)):
        system.GetInputPort("joint_positions").FixValue(context, positions)
        hand, expected = system.GetOutputPort("hand").Eval(context), by_the_plant(config, positions)
        np.testing.assert_allclose(hand.p_PH, expected.p_PH, atol=1e-9)
        np.testing.assert_array_equal(hand.radius, expected.radius)


def test_the_untouched_are_the_fingertips_that_are_named(system: HandVolume, config: HandConfig) -> None:
    untouched = system.GetOutputPort("untouched").Eval(make_context(system, untouched=("thumb", "ring")))
    plant, hand = make_hand_plant(config)
    context = plant.CreateDefaultContext()
    plant.SetPositions(context, POSITIONS)
    within = []
    for finger in ("thumb", "ring"):
        X_PS = plant.CalcRelativeTransform(context, hand.palm_frame, hand.sensor_frames[finger])
        tip = hand.surfaces[finger]
        p_FH = (X_PS @ RigidTransform(tip.X_SF)).inverse().multiply(untouched.p_PH.T).T
        p_FH[:, 2] -= np.clip(p_FH[:, 2], -tip.length / 2, tip.length / 2)
        within.append(np.linalg.norm(p_FH, axis=1) + untouched.radius < tip.radius + 1e-6)
    assert np.all(np.sum(within, axis=0) == 1)
    assert np.all(np.any(within, axis=1))


def test_the_untouched_follow_the_joints(system: HandVolume) -> None:
    context = make_context(system, untouched=("thumb",))
    before = system.GetOutputPort("untouched").Eval(context).p_PH
    system.GetInputPort("joint_positions").FixValue(context, np.zeros(24))
    after = system.GetOutputPort("untouched").Eval(context).p_PH
    assert np.linalg.norm(after - before, axis=1).min() > 1e-3


@pytest.mark.parametrize("untouched", [None, ()])
def test_where_no_fingertip_is_untouched_there_is_nothing(system: HandVolume, untouched: object) -> None:
    assert system.GetOutputPort("untouched").Eval(make_context(system, untouched=untouched)) is None


def test_a_joint_position_that_is_not_finite_leaves_out_what_it_moves(system: HandVolume) -> None:
    whole = system.GetOutputPort("hand").Eval(make_context(system, untouched=("thumb",)))
    context = make_context(system, np.full(24, np.nan), untouched=("thumb",))
    palm_alone = system.GetOutputPort("hand").Eval(context)
    assert system.GetOutputPort("untouched").Eval(context) is None
    # Whatever the joints, the palm is where it is.
    assert 0 < len(palm_alone.radius) < len(whole.radius) / 2
    gaps = np.linalg.norm(palm_alone.p_PH[:, None] - whole.p_PH, axis=2).min(axis=1)
    np.testing.assert_allclose(gaps, 0.0, atol=1e-9)
    first_finger = POSITIONS.copy()
    first_finger[2] = np.nan
    context = make_context(system, first_finger, untouched=("thumb",))
    assert len(palm_alone.radius) < len(system.GetOutputPort("hand").Eval(context).radius) < len(whole.radius)
    assert system.GetOutputPort("untouched").Eval(context) is not None


def test_a_value_of_another_type_is_refused_by_the_name_of_the_port(system: HandVolume) -> None:
    with pytest.raises(
        PortTypeError, match="'fingers_untouched' of system 'hand_volume' must hold a tuple, not a list"
    ):
        system.GetOutputPort("untouched").Eval(make_context(system, untouched=["thumb"]))


def test_a_finger_that_the_hand_lacks_is_refused_by_the_name_of_the_port(system: HandVolume) -> None:
    with pytest.raises(PortTypeError, match=r"'fingers_untouched' of .* must hold names among .*thumb.*, not 'index'"):
        system.GetOutputPort("untouched").Eval(make_context(system, untouched=("index",)))
