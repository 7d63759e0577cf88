import math

import numpy as np
import pytest
import trimesh
from pydrake.geometry import Sphere
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import AddMultibodyPlant, CoulombFriction, MultibodyPlant, MultibodyPlantConfig
from pydrake.multibody.tree import FixedOffsetFrame, SpatialInertia
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, Diagram, DiagramBuilder
from pydrake.systems.primitives import AddRandomInputs

from tactopose_drake.core.poses import increments_between
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.vision.vision_model import VisionModel
from tactopose_drake.errors import InvalidInputError
from tactopose_drake.systems.camera_view import CameraView
from tactopose_drake.systems.random_sources import seed_random_sources
from tactopose_drake.systems.simulated_vision import SimulatedVision, SimulatedVisionParams
from tests.core.models import globe

X_WPalm = RigidTransform(RollPitchYaw(0.2, 0.1, 0.5), [0.1, 0.1, 0.1])
X_PalmP = RigidTransform(RollPitchYaw(0.0, 0.7, 0.0), [0.0, 0.02, 0.05])
X_WO = RigidTransform(RollPitchYaw(0.5, -0.3, 1.2), [0.0, 0.05, 0.5])
X_WC = RigidTransform([0.0, 0.05, 2.0])  # straight above the object
MODEL = VisionModel(
    translation_clear=0.004, translation_hidden=0.05, rotation_clear_deg=1.0, rotation_hidden_deg=21.0, lost_share=1.0
)


@pytest.fixture(scope="module")
def object_model() -> ObjectModel:
    return globe(0.04)


def make_station(
    object_model: ObjectModel, p_WFinger: tuple[float, float, float], X_WO: RigidTransform = X_WO
) -> tuple[Diagram, MultibodyPlant, SimulatedVision]:
    """An object, a palm, and a ball of 5 cm on the palm's model instance at a point of the world."""
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlant(MultibodyPlantConfig(time_step=1e-3), builder)
    inertia = SpatialInertia.SolidSphereWithMass(0.1, 0.02)
    palm = plant.AddRigidBody("palm", plant.AddModelInstance("hand"), inertia)
    thing = plant.AddRigidBody("object", plant.AddModelInstance("object"), inertia)
    palm_frame = plant.AddFrame(FixedOffsetFrame("palm_frame", palm.body_frame(), X_PalmP))
    plant.WeldFrames(plant.world_frame(), palm.body_frame(), X_WPalm)
    plant.WeldFrames(plant.world_frame(), thing.body_frame(), X_WO)
    X_PalmG = X_WPalm.inverse() @ RigidTransform(p_WFinger)
    plant.RegisterCollisionGeometry(palm, X_PalmG, Sphere(0.05), "ball", CoulombFriction(1.0, 1.0))
    plant.Finalize()
    vision = builder.AddNamedSystem(
        "vision",
        SimulatedVision(
            CameraView(
                plant=plant,
                inspector=scene_graph.model_inspector(),
                object_body=thing,
                object_model=object_model,
                palm_frame=palm_frame,
                X_WC=X_WC,
            ),
            params=SimulatedVisionParams(model=MODEL, period=0.1),
        ),
    )
    builder.Connect(plant.get_body_poses_output_port(), vision.GetInputPort("body_poses"))
    AddRandomInputs(0.1, builder)
    return builder.Build(), plant, vision


def look_once(diagram: Diagram, vision: SimulatedVision, seed: int = 0, duration: float = 0.01) -> Context:
    context = diagram.CreateDefaultContext()
    seed_random_sources(diagram, context, seed)
    simulator = Simulator(diagram, context)
    simulator.Initialize()
    simulator.AdvanceTo(duration)
    return vision.GetMyContextFromRoot(context)


def test_a_frame_is_forgotten_once_the_clock_is_set_back(object_model: ObjectModel) -> None:
    diagram, _, vision = make_station(object_model, (0.0, 0.5, 0.6))
    simulator = Simulator(diagram)
    simulator.AdvanceTo(0.05)
    context = simulator.get_mutable_context()
    seen = vision.GetOutputPort("prior")
    assert seen.Eval(vision.GetMyContextFromRoot(context)) is not None
    context.SetTime(0.0)
    simulator.Initialize()
    assert seen.Eval(vision.GetMyContextFromRoot(context)) is None
    simulator.AdvanceTo(0.01)
    assert seen.Eval(vision.GetMyContextFromRoot(context)) is not None


@pytest.mark.parametrize(("p_WFinger", "hidden"), [((0.0, 0.5, 0.6), 0.0), ((0.0, 0.05, 0.6), 1.0)])
def test_the_error_is_that_of_the_hidden_share(object_model: ObjectModel, p_WFinger, hidden: float) -> None:
    diagram, _, vision = make_station(object_model, p_WFinger)
    context = look_once(diagram, vision)
    assert vision.GetOutputPort("hidden_share").Eval(context)[0] == pytest.approx(hidden, abs=0.02)
    prior = vision.GetOutputPort("prior").Eval(context)
    error = increments_between(((X_WPalm @ X_PalmP).inverse() @ X_WO).GetAsMatrix34(), prior.mean)
    assert np.linalg.norm(error[3:]) == pytest.approx(0.05 if hidden else 0.004, rel=0.05)
    assert np.linalg.norm(error[:3]) == pytest.approx(math.radians(21 if hidden else 1), rel=0.05)


def test_of_an_object_far_from_its_frame_s_origin_the_error_is_that_of_the_middle(object_model: ObjectModel) -> None:
    p_OM = np.array([0.5, 0.0, 0.0])
    moved = trimesh.Trimesh(object_model.vertices + p_OM, object_model.faces)
    far = ObjectModel.from_mesh(moved, symmetry="none", cache=False)
    diagram, _, vision = make_station(far, (0.0, 0.05, 0.6), X_WO @ RigidTransform(-p_OM))
    prior = vision.GetOutputPort("prior").Eval(look_once(diagram, vision))
    X_PM = (X_WPalm @ X_PalmP).inverse() @ X_WO
    error = increments_between(X_PM.GetAsMatrix34(), (prior.X_PO @ RigidTransform(p_OM)).GetAsMatrix34())
    assert np.linalg.norm(error[3:]) == pytest.approx(0.05, rel=0.05)
    assert np.linalg.norm(error[:3]) == pytest.approx(math.radians(21), rel=0.05)


def test_a_ball_at_the_objects_edge_hides_a_part(object_model: ObjectModel) -> None:
    diagram, _, vision = make_station(object_model, (0.04, 0.05, 0.6))
    hidden = vision.GetOutputPort("hidden_share").Eval(look_once(diagram, vision))[0]
    assert 0.3 < hidden < 0.9


def test_how_much_of_a_ball_is_hidden_does_not_hang_on_how_it_is_turned(object_model: ObjectModel) -> None:
    shares = []
    for turn in (0.0, 0.5 * math.pi, math.pi):
        X_turned = X_WO @ RigidTransform(RollPitchYaw(turn, 0.3, 0.0), np.zeros(3))
        diagram, _, vision = make_station(object_model, (0.04, 0.05, 0.6), X_turned)
        shares.append(vision.GetOutputPort("hidden_share").Eval(look_once(diagram, vision))[0])
    np.testing.assert_allclose(shares, shares[0], atol=0.08)


def test_the_same_seed_sees_the_same_and_each_frame_errs_anew(object_model: ObjectModel) -> None:
    diagram, _, vision = make_station(object_model, (0.0, 0.05, 0.6))
    poses = [
        vision.GetOutputPort("prior").Eval(look_once(diagram, vision, seed, duration)).mean
        for seed, duration in ((3, 0.05), (3, 0.05), (4, 0.05), (3, 0.15))
    ]
    np.testing.assert_array_equal(poses[0], poses[1])
    assert not np.allclose(poses[0], poses[2])
    assert not np.allclose(poses[0], poses[3])


def test_there_is_no_prior_before_the_first_frame(object_model: ObjectModel) -> None:
    diagram, _, vision = make_station(object_model, (0.0, 0.05, 0.6))
    context = vision.GetMyContextFromRoot(diagram.CreateDefaultContext())
    assert vision.GetOutputPort("prior").Eval(context) is None


def test_a_bad_parameter_is_named() -> None:
    with pytest.raises(InvalidInputError, match=r"SimulatedVisionParams\.period must be .*, not 0"):
        SimulatedVisionParams(period=0.0).validate()
