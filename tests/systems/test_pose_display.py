import dataclasses

import numpy as np
import pytest
from pydrake.common.value import AbstractValue
from pydrake.geometry import Meshcat, MeshcatParams
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import FixedOffsetFrame, SpatialInertia
from pydrake.systems.analysis import Simulator

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.sensing.patches import describe_patch
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.errors import InvalidInputError, PortTypeError
from tactopose_drake.estimation.pose_hypothesis import PoseHypothesis
from tactopose_drake.estimation.prior import PosePrior
from tactopose_drake.estimation.results import PoseEstimate
from tactopose_drake.systems.pose_display import PoseDisplay, PoseDisplayParams
from tests.core.models import brick
from tests.recording_meshcat import RecordingMeshcat

X_PO = RigidTransform(RollPitchYaw(0.3, 0.2, 0.1), [0.01, 0.02, 0.1])
X_WPalm = RigidTransform(RollPitchYaw(1.3, -0.2, 0.7), [1.0, 2.0, 3.0])
X_PalmP = RigidTransform(RollPitchYaw(0.0, 0.5, 0.0), [0.0, 0.0, 0.05])
TOUCH = Contacts([[0.03, 0, 0], [-0.03, 0, 0]], [[1, 0, 0], [-1, 0, 0]], [[2, 0, 0], [-1, 0, 0.2]])


@pytest.fixture(scope="module")
def model() -> ObjectModel:
    return brick(0.06, 0.08, 0.1)


def run(display: PoseDisplay, duration: float = 0.001, **inputs: object) -> None:
    simulator = Simulator(display)
    for name, value in inputs.items():
        display.GetInputPort(name).FixValue(simulator.get_mutable_context(), AbstractValue.Make(value))
    simulator.Initialize()
    simulator.AdvanceTo(duration)


def test_prior_and_estimate_are_where_they_say(model: ObjectModel) -> None:
    meshcat = RecordingMeshcat()
    prior = PosePrior(RigidTransform([0.0, 0.0, 0.2]))
    run(PoseDisplay(meshcat, model), contacts=TOUCH, prior=prior, object_pose=X_PO)
    assert meshcat.pose("/tactopose/estimate").IsNearlyEqualTo(X_PO, 1e-12)
    np.testing.assert_allclose(meshcat.pose("/tactopose/prior").GetAsMatrix34(), prior.X_PO.GetAsMatrix34())
    assert meshcat.visible("/tactopose/prior")


def test_what_is_newer_than_the_last_period_is_shown_when_asked(model: ObjectModel) -> None:
    meshcat = RecordingMeshcat()
    display = PoseDisplay(meshcat, model, params=PoseDisplayParams(period=10.0))
    simulator = Simulator(display)
    context = simulator.get_mutable_context()
    display.GetInputPort("contacts").FixValue(context, AbstractValue.Make(TOUCH))
    display.GetInputPort("object_pose").FixValue(context, AbstractValue.Make(RigidTransform()))
    simulator.Initialize()
    simulator.AdvanceTo(0.1)
    display.GetInputPort("object_pose").FixValue(context, AbstractValue.Make(X_PO))
    assert not meshcat.pose("/tactopose/estimate").IsNearlyEqualTo(X_PO, 1e-3)
    display.ForcedPublish(context)
    assert meshcat.pose("/tactopose/estimate").IsNearlyEqualTo(X_PO, 1e-12)


def test_poses_of_bodies_without_a_palm_frame_are_refused(model: ObjectModel) -> None:
    display = PoseDisplay(RecordingMeshcat(), model)
    with pytest.raises(
        PortTypeError, match=r"'body_poses' of system .* must not be connected to a display without a palm_"
    ):
        run(display, contacts=TOUCH, object_pose=X_PO, body_poses=[RigidTransform(), X_WPalm])


def test_a_forced_publish_needs_no_simulation(model: ObjectModel) -> None:
    meshcat = RecordingMeshcat()
    display = PoseDisplay(meshcat, model)
    context = display.CreateDefaultContext()
    display.GetInputPort("contacts").FixValue(context, AbstractValue.Make(TOUCH))
    display.GetInputPort("object_pose").FixValue(context, AbstractValue.Make(X_PO))
    for _ in range(2):
        display.ForcedPublish(context)
        assert {"/tactopose/estimate", "/tactopose/prior"} <= meshcat.objects.keys()
        assert meshcat.pose("/tactopose/estimate").IsNearlyEqualTo(X_PO, 1e-12)
        assert len(meshcat.cameras) == 1
    meshcat.Delete("/tactopose")
    display.ForcedPublish(context)
    assert "/tactopose/estimate" in meshcat.objects


def test_everything_moves_with_the_palm(model: ObjectModel) -> None:
    plant = MultibodyPlant(0.0)
    plant.AddRigidBody("stand", SpatialInertia.SolidSphereWithMass(1.0, 0.1))
    palm = plant.AddRigidBody("palm", SpatialInertia.SolidSphereWithMass(1.0, 0.1))
    palm_frame = plant.AddFrame(FixedOffsetFrame("palm_frame", palm.body_frame(), X_PalmP))
    plant.Finalize()
    meshcat = RecordingMeshcat()
    body_poses = [RigidTransform(), RigidTransform([9.0, 9.0, 9.0]), X_WPalm]
    display = PoseDisplay(meshcat, model, palm_frame)
    run(display, contacts=TOUCH, object_pose=X_PO, body_poses=body_poses)
    assert meshcat.pose("/tactopose/estimate").IsNearlyEqualTo(X_WPalm @ X_PalmP @ X_PO, 1e-12)
    p_WC = meshcat.pose("/tactopose/touch/0/point").translation()
    np.testing.assert_allclose(p_WC, X_WPalm @ X_PalmP @ TOUCH.p_PC[0])


@pytest.mark.parametrize("inputs", [{}, {"prior": None}])
def test_without_a_prior_none_is_shown(model: ObjectModel, inputs: dict[str, object]) -> None:
    meshcat = RecordingMeshcat()
    run(PoseDisplay(meshcat, model), contacts=TOUCH, object_pose=X_PO, **inputs)
    assert not meshcat.visible("/tactopose/prior")
    assert meshcat.visible("/tactopose/estimate")


def test_only_the_contacts_there_are_are_shown(model: ObjectModel) -> None:
    meshcat = RecordingMeshcat()
    run(PoseDisplay(meshcat, model, params=PoseDisplayParams(max_contacts=4)), contacts=TOUCH, object_pose=X_PO)
    assert [meshcat.visible(f"/tactopose/touch/{row}/point") for row in range(4)] == [True, True, False, False]
    assert "/tactopose/touch/4/point" not in meshcat.objects


def test_more_contacts_than_can_be_shown_are_no_failure(model: ObjectModel) -> None:
    meshcat = RecordingMeshcat()
    run(PoseDisplay(meshcat, model, params=PoseDisplayParams(max_contacts=1)), contacts=TOUCH, object_pose=X_PO)
    assert meshcat.visible("/tactopose/touch/0/point")
    assert "/tactopose/touch/1/point" not in meshcat.objects


def test_a_second_simulation_starts_afresh(model: ObjectModel) -> None:
    meshcat = RecordingMeshcat()
    run(PoseDisplay(meshcat, model, params=PoseDisplayParams(max_contacts=9)), contacts=TOUCH, object_pose=X_PO)
    run(PoseDisplay(meshcat, model, params=PoseDisplayParams(max_contacts=1)), contacts=TOUCH, object_pose=X_PO)
    assert "/tactopose/touch/8/point" not in meshcat.objects


def test_the_motion_is_recorded_at_the_simulations_time(model: ObjectModel) -> None:
    meshcat = RecordingMeshcat()
    params = PoseDisplayParams(period=0.25)
    run(PoseDisplay(meshcat, model, params=params), duration=0.6, contacts=TOUCH, object_pose=X_PO)
    assert {time for time in meshcat.times if time is not None} == {0.0, 0.25, 0.5}


def estimate_at(X_PO: RigidTransform, *shares: float) -> PoseEstimate:
    spin = np.array([[0.0, 0.0, 1.0, 0.0, 0.0, 0.0]])
    hypotheses = (PoseHypothesis(X_PO, 1.0, share, 1e-6 * np.eye(6), spin) for share in shares)
    return PoseEstimate(tuple(hypotheses), "ambiguous", 0.01)


def test_the_hypotheses_say_more_than_the_pose(model: ObjectModel) -> None:
    meshcat = RecordingMeshcat()
    estimate = estimate_at(X_PO, 0.7, 0.299, 0.001)
    run(PoseDisplay(meshcat, model), contacts=TOUCH, object_pose=RigidTransform(), hypotheses=estimate)
    assert meshcat.pose("/tactopose/estimate").IsNearlyEqualTo(X_PO, 1e-12)
    assert [meshcat.visible(f"/tactopose/alternatives/{row}") for row in range(2)] == [True, False]
    assert meshcat.visible("/tactopose/estimate/uncertainty/0")
    assert [meshcat.visible(f"/tactopose/free/0/{kind}") for kind in ("turn", "slide")] == [True, False]


@pytest.mark.parametrize(("inlier", "crossed"), [([0.1, 0.9, 0.8], True), ([0.1], False)])
def test_a_false_contact_is_crossed_and_one_that_came_later_is_not_judged(
    model: ObjectModel, inlier: list[float], crossed: bool
) -> None:
    meshcat = RecordingMeshcat()
    estimate = estimate_at(X_PO, 1.0)
    doubted = dataclasses.replace(estimate.hypotheses[0], inlier_probability=np.array(inlier[: len(TOUCH)]))
    estimate = dataclasses.replace(estimate, hypotheses=(doubted,))
    contacts = TOUCH if crossed else Contacts(np.concatenate([TOUCH.p_PC, TOUCH.p_PC]))
    run(PoseDisplay(meshcat, model), contacts=contacts, object_pose=RigidTransform(), hypotheses=estimate)
    assert meshcat.visible("/tactopose/touch/0/point") != crossed
    assert meshcat.visible("/tactopose/touch/0/false") == crossed


def test_without_a_hypothesis_no_estimate_is_shown(model: ObjectModel) -> None:
    meshcat = RecordingMeshcat()
    run(PoseDisplay(meshcat, model), contacts=TOUCH, object_pose=X_PO, hypotheses=None)
    assert not meshcat.visible("/tactopose/estimate")
    assert meshcat.visible("/tactopose/touch/0/point")


@pytest.mark.parametrize("aims", [True, False])
def test_the_camera_is_aimed_once_at_what_is_known(model: ObjectModel, aims: bool) -> None:
    meshcat = RecordingMeshcat()
    prior = PosePrior(RigidTransform([0.0, 0.0, 0.2]))
    display = PoseDisplay(meshcat, model, params=PoseDisplayParams(aim_camera=aims))
    run(display, 0.1, contacts=Contacts.empty(), prior=prior, object_pose=X_PO, hypotheses=None)
    assert len(meshcat.cameras) == aims
    if aims:
        assert np.linalg.norm(meshcat.target - [0.0, 0.0, 0.2]) < 0.01
        assert 0.05 < np.linalg.norm(meshcat.camera - meshcat.target) < 0.5
        # The background and the grid stay the user's.
        assert not [path for path, _ in meshcat.properties if not path.startswith("/tactopose")]


def test_the_middles_of_patches_are_contacts(model: ObjectModel) -> None:
    meshcat = RecordingMeshcat()
    n_PT = np.tile([0.0, 0.0, -1.0], (3, 1))
    cells = [[0.0, 0.0, 0.05], [0.01, 0.0, 0.05], [0.0, 0.01, 0.05]]
    patch = describe_patch(cells, [1e4, 1e4, 1e4], alpha=1e-8, n_PT=n_PT)
    run(PoseDisplay(meshcat, model), contacts=TOUCH, patches=(patch,), object_pose=X_PO)
    assert [meshcat.visible(f"/tactopose/touch/{row}/point") for row in range(4)] == [True, True, True, False]
    np.testing.assert_allclose(meshcat.pose("/tactopose/touch/2").translation(), patch.centroid)
    assert not meshcat.visible("/tactopose/touch/2/force")


def test_the_pressed_cells_of_patches_are_shown_and_move_with_the_palm(model: ObjectModel) -> None:
    cells = [[0.0, 0.0, 0.05], [0.01, 0.0, 0.05], [0.0, 0.01, 0.05]]
    patch = describe_patch(cells, [1e4, 0.0, 2e4], alpha=1e-8, n_PT=np.tile([0.0, 0.0, -1.0], (3, 1)))
    plant = MultibodyPlant(0.0)
    palm = plant.AddRigidBody("palm", SpatialInertia.SolidSphereWithMass(1.0, 0.1))
    plant.Finalize()
    meshcat = RecordingMeshcat()
    params = PoseDisplayParams(max_pads=2, max_cells=5, period=0.25)
    display = PoseDisplay(meshcat, model, palm.body_frame(), params)
    inputs = {"patches": (patch,), "body_poses": [RigidTransform(), X_WPalm]}
    run(display, 0.6, contacts=TOUCH, object_pose=X_PO, **inputs)
    at = "/tactopose/patches/{}/cells/{}"
    assert [meshcat.visible(at.format(0, cell)) for cell in range(5)] == [True, False, True, False, False]
    assert not meshcat.visible(at.format(1, 0))
    np.testing.assert_allclose(meshcat.pose(at.format(0, 2)).translation(), X_WPalm @ cells[2])
    assert {time for time in meshcat.times if time is not None} == {0.0, 0.25, 0.5}


def test_meshcat_itself_takes_and_records_all_of_it(model: ObjectModel) -> None:
    patch = describe_patch(0.01 * np.eye(3), [1e4, 0.0, 2e4], alpha=1e-8, n_PT=np.tile([0.0, 0.0, -1.0], (3, 1)))
    meshcat = Meshcat(MeshcatParams(host="localhost"))
    meshcat.StartRecording()
    display = PoseDisplay(meshcat, model, params=PoseDisplayParams(frames=True, friction_coefficient=0.5))
    run(display, 0.1, contacts=TOUCH, patches=(patch,), object_pose=X_PO)
    meshcat.PublishRecording()
    for part in (
        "patches/3/cells/23",
        "palm/x",
        "estimate/frame/z",
        "touch/0/normal/cone",
        "touch/0/point/ball/through",
    ):
        assert meshcat.HasPath(f"/tactopose/{part}")
    assert "set_animation" in meshcat.StaticHtml()


def test_frames_and_cones_are_drawn_on_request_alone(model: ObjectModel) -> None:
    meshcat = RecordingMeshcat()
    run(PoseDisplay(meshcat, model), contacts=TOUCH, object_pose=X_PO)
    assert not [path for path in meshcat.objects if "frame" in path or "palm" in path or "cone" in path]
    run(PoseDisplay(meshcat, model, params=PoseDisplayParams(frames=True)), contacts=TOUCH, object_pose=X_PO)
    z = meshcat.pose("/tactopose/estimate/frame/z")
    np.testing.assert_allclose(z.rotation().matrix()[:, 2], X_PO.rotation().matrix()[:, 2], atol=1e-12)
    assert "/tactopose/palm/x" in meshcat.objects


def test_a_simulated_object_is_shown_as_wires_where_it_is(model: ObjectModel) -> None:
    plant = MultibodyPlant(0.0)
    bodies = [plant.AddRigidBody(name, SpatialInertia.SolidSphereWithMass(1.0, 0.1)) for name in ("palm", "object")]
    plant.Finalize()
    meshcat = RecordingMeshcat()
    display = PoseDisplay(meshcat, model, bodies[0].body_frame(), object_body=bodies[1])
    X_WO = RigidTransform(RollPitchYaw(0.1, 0.2, 0.3), [1.0, 2.0, 3.1])
    run(display, contacts=TOUCH, object_pose=X_PO, body_poses=[RigidTransform(), X_WPalm, X_WO])
    assert meshcat.pose("/tactopose/truth").IsNearlyEqualTo(X_WO, 1e-12)
    assert meshcat.visible("/tactopose/truth")


def test_the_camera_looks_at_a_simulated_object_of_which_nothing_is_known_yet(model: ObjectModel) -> None:
    plant = MultibodyPlant(0.0)
    bodies = [plant.AddRigidBody(name, SpatialInertia.SolidSphereWithMass(1.0, 0.1)) for name in ("palm", "object")]
    plant.Finalize()
    meshcat = RecordingMeshcat()
    display = PoseDisplay(meshcat, model, bodies[0].body_frame(), object_body=bodies[1])
    poses = [RigidTransform(), X_WPalm, RigidTransform([1.0, 2.0, 3.1])]
    run(display, contacts=Contacts.empty(), object_pose=X_PO, hypotheses=None, body_poses=poses)
    assert len(meshcat.cameras) == 1
    np.testing.assert_allclose(meshcat.target, [1.0, 2.0, 3.1], atol=0.1)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("period", 0.0),
        ("max_contacts", -1),
        ("max_pads", 2.5),
        ("max_alternatives", 1.5),
        ("friction_coefficient", 0.0),
        ("max_alternatives", 9),
        ("max_cells", -2),
    ],
)
def test_a_bad_parameter_is_named(name: str, value: float) -> None:
    with pytest.raises(InvalidInputError, match=f"{name} must be .*, not {value:g}"):
        PoseDisplayParams(**{name: value}).validate()


@pytest.mark.parametrize("path", ["", "/", "//", "/drake", "drake/"])
def test_a_path_that_holds_the_parts_of_others_is_refused(path: str) -> None:
    with pytest.raises(InvalidInputError, match=f"^PoseDisplayParams.path must be one of its own, .*, not '{path}'"):
        PoseDisplayParams(path=path).validate()


def test_what_is_no_display_and_no_object_is_refused_at_once(model: ObjectModel) -> None:
    with pytest.raises(InvalidInputError, match=r"^meshcat must be a Meshcat, such as from .*, not None"):
        PoseDisplay(None, model)
    with pytest.raises(InvalidInputError, match=r"^model must be an ObjectModel, not a str"):
        PoseDisplay(RecordingMeshcat(), "bust")
