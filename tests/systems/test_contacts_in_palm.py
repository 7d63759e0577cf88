import dataclasses
import math

import numpy as np
import pytest
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import FixedOffsetFrame, RevoluteJoint, SpatialInertia
from pydrake.systems.framework import Context

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.sensing.intrinsic_contact import ContactSolution, solve_contacts
from tactopose_drake.core.surfaces import Sphere
from tactopose_drake.errors import InvalidInputError, PortTypeError
from tactopose_drake.hand.contact_uncertainty import ContactUncertainty
from tactopose_drake.hand.hand_config import HandUncertainty, load_hand_config
from tactopose_drake.hand.hand_in_plant import make_hand_plant
from tactopose_drake.systems.contacts_in_palm import ContactsInPalm, ContactsInPalmParams

SURFACE = Sphere(radius=0.009, X_SF=RigidTransform([0, 0, 0.02]).GetAsMatrix34())
FINGERS = ("first", "thumb")
POSITIONS = np.array([0.7, -0.4])
NO_READING = solve_contacts(np.full((1, 6), np.nan), SURFACE)[0]


def make_hand(X_WPalm: RigidTransform = RigidTransform()) -> MultibodyPlant:  # noqa: B008
    """A palm with two fingers of one joint each, and a sensor frame askew on each."""
    plant = MultibodyPlant(0.0)
    inertia = SpatialInertia.SolidSphereWithMass(0.1, 0.02)
    palm = plant.AddRigidBody("palm", inertia)
    plant.WeldFrames(plant.world_frame(), palm.body_frame(), X_WPalm)
    for finger, side in zip(FINGERS, (0.03, -0.03), strict=True):
        root = plant.AddFrame(
            FixedOffsetFrame(
                f"{finger}_root", palm.body_frame(), RigidTransform(RollPitchYaw(0.1, side, 0), [side, 0, 0.05])
            )
        )
        link = plant.AddRigidBody(f"{finger}_link", inertia)
        plant.AddJoint(RevoluteJoint(f"{finger}_joint", root, link.body_frame(), [0, 1, 0]))
        X_LinkS = RigidTransform(RollPitchYaw(0.3, -0.2, 0.5), [0.0, 0.01, 0.06])
        plant.AddFrame(FixedOffsetFrame(f"{finger}_sensor", link.body_frame(), X_LinkS))
    plant.Finalize()
    return plant


def contact(force: float) -> ContactSolution:
    n = np.array([0.6, 0.0, 0.8])
    f_S = np.array([-0.6, 0.1, -0.8]) * force
    p_SC = 0.009 * n + SURFACE.X_SF[:, 3]
    return solve_contacts(np.concatenate([np.cross(p_SC, f_S), f_S])[None], SURFACE)[0]


def make_system(solutions: object, positions: np.ndarray = POSITIONS) -> tuple[ContactsInPalm, Context]:
    plant = make_hand()
    frames = {finger: plant.GetFrameByName(f"{finger}_sensor") for finger in FINGERS}
    params = ContactsInPalmParams(sigma_position=0.002, sigma_normal_deg=3.0)
    system = ContactsInPalm(plant, frames, plant.GetFrameByName("palm"), params)
    system.set_name("contacts_in_palm")
    context = system.CreateDefaultContext()
    system.GetInputPort("joint_positions").FixValue(context, positions)
    system.GetInputPort("contact_solutions").FixValue(context, AbstractValue.Make(solutions))
    return system, context


def read(system: ContactsInPalm, context: Context) -> tuple[Contacts, tuple[str, ...], str]:
    return tuple(system.GetOutputPort(name).Eval(context) for name in ("contacts", "fingers_in_contact", "status"))


def test_contacts_are_where_another_plant_puts_them() -> None:
    solutions = {"first": contact(1.0), "thumb": contact(2.0)}
    contacts, fingers, status = read(*make_system(solutions))
    assert (fingers, status) == (FINGERS, "ok")

    truth = make_hand(RigidTransform(RollPitchYaw(1.0, 0.5, -2.0), [1.0, 2.0, 3.0]))
    truth_context = truth.CreateDefaultContext()
    truth.SetPositions(truth_context, POSITIONS)
    X_WP = truth.GetFrameByName("palm").CalcPoseInWorld(truth_context)
    for row, finger in enumerate(fingers):
        X_WS = truth.GetFrameByName(f"{finger}_sensor").CalcPoseInWorld(truth_context)
        np.testing.assert_allclose(X_WP @ contacts.p_PC[row], X_WS @ solutions[finger].p_SC, atol=1e-12)
        n_W, f_W = X_WP.rotation() @ contacts.n_PC[row], X_WP.rotation() @ contacts.f_PC[row]
        np.testing.assert_allclose(n_W, -(X_WS.rotation() @ solutions[finger].n_S), atol=1e-12)
        force_S = solutions[finger].normal_force + solutions[finger].friction_force
        np.testing.assert_allclose(f_W, X_WS.rotation() @ force_S, atol=1e-12)


def test_the_normal_points_the_way_the_object_pushes() -> None:
    contacts, _, _ = read(*make_system({"first": contact(1.0), "thumb": contact(2.0)}))
    assert np.all(np.einsum("ki,ki->k", contacts.n_PC, contacts.f_PC) > 0)


def test_a_finger_that_touches_nothing_is_left_out_and_named() -> None:
    contacts, fingers, status = read(*make_system({"first": NO_READING, "thumb": contact(2.0)}))
    assert len(contacts) == 1
    assert fingers == ("thumb",)
    assert status == f"first: {NO_READING.reason}"


def test_only_a_sensor_that_feels_nothing_makes_its_finger_untouched() -> None:
    silent = solve_contacts(np.full((1, 6), 1e-4), SURFACE)[0]
    unexplained = solve_contacts(np.array([[1.0, 0, 0, 0, 0, -1.0]]), SURFACE)[0]
    assert not unexplained.valid
    for solution, expected in ((silent, ("first",)), (NO_READING, ()), (unexplained, ()), (contact(1.0), ())):
        system, context = make_system({"first": solution, "thumb": contact(2.0)})
        assert system.GetOutputPort("fingers_untouched").Eval(context) == expected


def test_no_contact_at_all_is_no_failure() -> None:
    contacts, fingers, status = read(*make_system({"first": NO_READING}))
    assert len(contacts) == 0
    assert fingers == ()
    assert status == f"first: {NO_READING.reason}; thumb: no solution"


def test_the_standard_deviations_are_the_parameters() -> None:
    contacts, _, _ = read(*make_system({"first": contact(1.0)}))
    assert contacts.sigma_position[0] == pytest.approx(0.002)
    assert contacts.sigma_normal[0] == pytest.approx(math.radians(3.0))


def test_the_contacts_follow_the_joints() -> None:
    system, context = make_system({"first": contact(1.0)})
    before = system.GetOutputPort("contacts").Eval(context).p_PC
    system.GetInputPort("joint_positions").FixValue(context, POSITIONS + 0.1)
    after = system.GetOutputPort("contacts").Eval(context).p_PC
    assert 0.003 < np.linalg.norm(after - before) < 0.02


def test_a_joint_position_that_is_not_finite_leaves_no_contacts() -> None:
    contacts, _, status = read(*make_system({"first": contact(1.0)}, positions=np.array([np.nan, 0.0])))
    assert len(contacts) == 0
    assert "joint position is not known" in status


def test_two_contexts_do_not_share_their_kinematics() -> None:
    system, context = make_system({"first": contact(1.0)})
    expected = system.GetOutputPort("contacts").Eval(context).p_PC
    other = context.Clone()
    system.GetInputPort("joint_positions").FixValue(other, POSITIONS + 1.0)
    assert not np.allclose(system.GetOutputPort("contacts").Eval(other).p_PC, expected)
    system.GetInputPort("contact_solutions").FixValue(context, AbstractValue.Make({"first": contact(3.0)}))
    np.testing.assert_allclose(system.GetOutputPort("contacts").Eval(context).p_PC, expected, atol=1e-12)


def test_a_value_of_another_type_is_refused_by_the_name_of_the_port() -> None:
    system, context = make_system(["not a dict"])
    with pytest.raises(
        PortTypeError, match="'contact_solutions' of system 'contacts_in_palm' must hold a dict, not a list"
    ):
        system.GetOutputPort("contacts").Eval(context)


def test_a_solution_that_is_none_is_refused_by_the_name_of_the_port() -> None:
    system, context = make_system({"first": 3})
    with pytest.raises(PortTypeError, match=r"'contact_solutions' of .* must hold a dict of .*, not one with an int"):
        system.GetOutputPort("contacts").Eval(context)


@pytest.mark.parametrize(
    "values",
    [
        {"sigma_position": 0.0},
        {"sigma_position": 1e3},
        {"sigma_position": 1e-8},
        {"sigma_normal_deg": 0.0},
        {"sigma_normal_deg": 1e-4},
    ],
)
def test_a_bad_parameter_is_named(values: dict[str, float]) -> None:
    (name,) = values
    with pytest.raises(InvalidInputError, match=f"^ContactsInPalmParams.{name} must be "):
        ContactsInPalmParams(**values).validate()


def test_a_hand_that_errs_in_nothing_knows_its_contacts_to_a_hundredth_of_a_millimetre() -> None:
    none = HandUncertainty(**{field.name: 0.0 for field in dataclasses.fields(HandUncertainty)})
    plant, hand = make_hand_plant(load_hand_config("shadow_like"))
    finger = hand.fingers[0]
    surface = hand.surfaces[finger]
    n_S = surface.X_SF[:, :3] @ np.array([0.6, 0.64, 0.48])
    p_SC = surface.X_SF[:, 3] + 0.009 * n_S
    solution = solve_contacts(np.concatenate([np.cross(p_SC, -2.0 * n_S), -2.0 * n_S])[None], surface)[0]
    assert solution.valid
    system = ContactsInPalm(
        plant, hand.sensor_frames, hand.palm_frame, uncertainty=ContactUncertainty(plant, hand, none)
    )
    context = system.CreateDefaultContext()
    system.GetInputPort("joint_positions").FixValue(context, np.zeros(plant.num_positions()))
    system.GetInputPort("contact_solutions").FixValue(context, AbstractValue.Make({finger: solution}))
    contacts = system.GetOutputPort("contacts").Eval(context)
    np.testing.assert_allclose(contacts.covariance[0], np.diag(np.repeat([1e-5**2, 1e-3**2], 3)), atol=1e-16)


@pytest.mark.parametrize(("share", "is_contact"), [(0.0, True), (-2.0, True), (0.9, True), (1.1, False), (3.0, False)])
def test_a_force_that_the_own_acceleration_explains_is_no_contact_and_the_finger_is_not_known_to_be_untouched(
    share: float, is_contact: bool
) -> None:
    system, context = make_system({"first": contact(0.1), "thumb": contact(2.0)})
    assert system.GetOutputPort("fingers_in_contact").Eval(context) == FINGERS
    f_PC = system.GetOutputPort("contacts").Eval(context).f_PC
    across = np.cross(f_PC[0], [1.0, 0.0, 0.0])  # which explains nothing of it
    forces = {"first": np.array([across, share * f_PC[0] + across]), "thumb": np.array([f_PC[0], f_PC[0]])}
    system.GetInputPort("inertial_forces").FixValue(context, AbstractValue.Make(forces))
    contacts, fingers, status = read(system, context)
    assert fingers == (FINGERS if is_contact else FINGERS[1:])
    assert status == ("ok" if is_contact else "first: its own acceleration explains the force")
    assert len(contacts) == len(fingers)
    assert system.GetOutputPort("fingers_untouched").Eval(context) == ()
    # What the solver says of it stays as it is.
    assert system.GetInputPort("contact_solutions").Eval(context)["first"].valid
