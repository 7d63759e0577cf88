import dataclasses

import numpy as np
import pytest
import trimesh
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.grasping.quality import GraspQuality, force_closure_probability, grasp_quality
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.errors import InvalidInputError, PortTypeError, UnknownNameError
from tactopose_drake.estimation.pose_hypothesis import PoseHypothesis
from tactopose_drake.estimation.results import PoseEstimate
from tactopose_drake.systems.grasp_quality_evaluator import GraspQualityEvaluator, GraspQualityParams
from tactopose_drake.systems.wrench_space_display import WrenchSpaceDisplay, WrenchSpaceDisplayParams
from tests.recording_meshcat import RecordingMeshcat

P_OC = np.array([[0.03, 0.005, 0.0], [-0.03, -0.02, 0.03], [-0.03, 0.02, 0.02], [-0.03, 0.0, -0.04]])


@pytest.fixture(scope="module")
def box() -> ObjectModel:
    mesh = trimesh.creation.box((0.06, 0.08, 0.12))
    return ObjectModel.from_mesh(mesh, max_grid_bytes=3_200_000, symmetry="none", samples=300)


def hypotheses(*probabilities: float) -> PoseEstimate:
    """The first where the box is, the others half a metre away."""
    return PoseEstimate(
        tuple(
            PoseHypothesis(RigidTransform([-0.5 * i, 0, 0]), 0.0, p, 1e-12 * np.eye(6), np.zeros((0, 6)))
            for i, p in enumerate(probabilities)
        ),
        "ambiguous",
        0.01,
    )


def evaluate(system: GraspQualityEvaluator, **inputs: object) -> dict[str, object]:
    simulator = Simulator(system)
    context = simulator.get_mutable_context()
    values = {"contacts": Contacts(P_OC), "object_pose": RigidTransform()} | inputs
    for name, value in values.items():
        system.GetInputPort(name).FixValue(context, AbstractValue.Make(value))
    simulator.AdvanceTo(0.001)
    names = ("quality", "radius", "volume", "force_closure", "probability")
    return {name: system.GetOutputPort(name).Eval(context) for name in names}


def test_the_ports_say_what_the_core_finds(box: ObjectModel) -> None:
    out = evaluate(GraspQualityEvaluator(box), hypotheses=hypotheses(0.75, 0.25))
    quality = grasp_quality(box, Contacts(P_OC), RigidTransform(), friction=0.6)
    assert isinstance(out["quality"], GraspQuality)
    assert out["radius"] == pytest.approx(quality.radius)
    assert quality.radius > 0
    assert out["volume"] == pytest.approx(quality.volume)
    assert out["force_closure"] == [1.0]
    assert out["probability"] == pytest.approx(0.75, abs=0.15)


def test_without_hypotheses_there_is_no_probability(box: ObjectModel) -> None:
    assert np.isnan(evaluate(GraspQualityEvaluator(box))["probability"])


def test_an_open_hand_holds_nothing(box: ObjectModel) -> None:
    out = evaluate(GraspQualityEvaluator(box), contacts=Contacts.empty(), hypotheses=hypotheses(1.0))
    assert out["radius"] == out["volume"] == out["force_closure"] == out["probability"] == [0.0]


@pytest.mark.parametrize("lost", [None, dataclasses.replace(hypotheses(1.0), status="no_solution")])
def test_a_pose_that_is_no_estimate_is_not_judged(box: ObjectModel, lost: PoseEstimate | None) -> None:
    out = evaluate(GraspQualityEvaluator(box), hypotheses=lost)
    assert out["quality"] is None
    assert out["radius"] == out["volume"] == out["force_closure"] == [0.0]
    assert np.isnan(out["probability"])


def test_outputs_are_held_between_periods(box: ObjectModel) -> None:
    system = GraspQualityEvaluator(box, GraspQualityParams(period=0.1))
    simulator = Simulator(system)
    context = simulator.get_mutable_context()
    system.GetInputPort("object_pose").FixValue(context, AbstractValue.Make(RigidTransform()))
    contacts = system.GetInputPort("contacts")
    contacts.FixValue(context, AbstractValue.Make(Contacts(P_OC)))
    assert system.GetOutputPort("quality").Eval(context) is None
    for name, value in (("radius", 0.0), ("volume", 0.0), ("force_closure", 0.0), ("probability", np.nan)):
        np.testing.assert_array_equal(system.GetOutputPort(name).Eval(context), [value], name)
    simulator.AdvanceTo(0.05)
    held = system.GetOutputPort("radius").Eval(context)[0]
    contacts.FixValue(context, AbstractValue.Make(Contacts(P_OC[:2])))
    simulator.AdvanceTo(0.09)
    assert system.GetOutputPort("radius").Eval(context)[0] == held > 0.0
    simulator.AdvanceTo(0.11)
    assert system.GetOutputPort("radius").Eval(context)[0] == 0.0


def test_each_finger_at_its_limit_has_no_volume_in_time(box: ObjectModel) -> None:
    params = GraspQualityParams(norm="Linf", edges=4)
    out = evaluate(GraspQualityEvaluator(box, params), contacts=Contacts(P_OC[:3]))
    together = grasp_quality(box, Contacts(P_OC[:3]), RigidTransform(), friction=0.6, edges=4)
    assert out["radius"] >= together.radius > 0
    assert np.isnan(out["volume"])


def test_the_edges_of_the_friction_cone_are_those_asked_for(box: ObjectModel) -> None:
    """A coarse pyramid lies within a fine one, and holds less."""
    rough = dataclasses.replace(hypotheses(1.0).best, covariance=np.diag(np.repeat([0.3, 0.005], 3) ** 2))
    estimate = PoseEstimate((rough,), "ok", 0.01)
    found = {
        edges: evaluate(GraspQualityEvaluator(box, GraspQualityParams(friction=0.25, edges=edges)), hypotheses=estimate)
        for edges in (3, 16)
    }
    for edges, out in found.items():
        quality = grasp_quality(box, Contacts(P_OC), RigidTransform(), friction=0.25, edges=edges)
        closure = force_closure_probability(
            box, Contacts(P_OC), estimate.modes, friction=0.25, edges=edges, samples=200
        )
        assert (out["radius"], out["probability"]) == (quality.radius, closure.value)
    assert found[3]["radius"] < found[16]["radius"]
    assert found[3]["probability"] < found[16]["probability"]


def test_the_display_draws_green_forces_and_red_torques(box: ObjectModel) -> None:
    builder, meshcat = DiagramBuilder(), RecordingMeshcat()
    evaluator = builder.AddNamedSystem("evaluator", GraspQualityEvaluator(box))
    params = WrenchSpaceDisplayParams(scale=0.2, place=[1.0, 2.0, 3.0])
    display = builder.AddNamedSystem("display", WrenchSpaceDisplay(meshcat, params))
    builder.Connect(evaluator.GetOutputPort("quality"), display.GetInputPort("quality"))
    diagram = builder.Build()
    simulator = Simulator(diagram)
    context = evaluator.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    evaluator.GetInputPort("contacts").FixValue(context, AbstractValue.Make(Contacts(P_OC)))
    evaluator.GetInputPort("object_pose").FixValue(context, AbstractValue.Make(RigidTransform()))
    simulator.AdvanceTo(0.6)
    np.testing.assert_array_equal(meshcat.pose("/tactopose_wrenches").translation(), [1, 2, 3])
    quality = evaluator.GetOutputPort("quality").Eval(context)
    vertices, _, rgba = meshcat.objects["/tactopose_wrenches/forces/faces"]
    assert rgba.g() > rgba.r()
    edges = 0.2 * quality.space.primitives[..., 3:].reshape(-1, 3)
    gaps = np.linalg.norm(vertices.T[:, None] - np.concatenate([edges, np.zeros((1, 3))]), axis=-1).min(axis=1)
    assert gaps.max() < 1e-9
    _, _, rgba = meshcat.objects["/tactopose_wrenches/torques/faces"]
    assert rgba.r() > rgba.g()
    # Two contacts with forces in one plane only: nothing is left of what was drawn.
    flat = dataclasses.replace(quality.space, primitives=quality.space.primitives[:0])
    context_display = display.CreateDefaultContext()
    display.GetInputPort("quality").FixValue(
        context_display, AbstractValue.Make(dataclasses.replace(quality, space=flat))
    )
    display.ForcedPublish(context_display)
    assert not [path for path in meshcat.objects if path.startswith("/tactopose_wrenches/")]


def test_the_camera_is_aimed_at_the_wrenches_where_that_is_asked() -> None:
    meshcat, place = RecordingMeshcat(), [1.0, 2.0, 3.0]
    for aims in (False, True):
        params = WrenchSpaceDisplayParams(scale=0.2, place=place, aim_camera=aims)
        display = WrenchSpaceDisplay(meshcat, params)
        simulator = Simulator(display)
        display.GetInputPort("quality").FixValue(simulator.get_mutable_context(), AbstractValue.Make(None))
        simulator.Initialize()
        assert len(meshcat.cameras) == aims
    np.testing.assert_array_equal(meshcat.target, place)
    assert 1.0 < np.linalg.norm(meshcat.camera - meshcat.target) < 2.0


def test_impossible_parameters_and_inputs_are_refused(box: ObjectModel) -> None:
    with pytest.raises(InvalidInputError, match=r"GraspQualityParams\.friction must be .*, not -1"):
        GraspQualityEvaluator(box, GraspQualityParams(friction=-1.0))
    GraspQualityParams(friction=0.0).validate()
    with pytest.raises(InvalidInputError, match=r"GraspQualityParams\.edges must be an integer .*, not 2"):
        GraspQualityEvaluator(box, GraspQualityParams(edges=2))
    with pytest.raises(InvalidInputError, match=r"GraspQualityParams\.samples must be an integer .*, not 2\.5"):
        GraspQualityEvaluator(box, GraspQualityParams(samples=2.5))
    for name, value in (("friction", 1001), ("edges", 65), ("samples", 1_000_001)):  # What no evaluation takes.
        with pytest.raises(InvalidInputError, match=rf"GraspQualityParams\.{name} must be .*, not {value}"):
            GraspQualityParams(**{name: value}).validate()
    with pytest.raises(InvalidInputError, match=r"^model must be an ObjectModel, not an int"):
        GraspQualityEvaluator(3)
    with pytest.raises(InvalidInputError, match=r"^params must be a GraspQualityParams, not an int"):
        GraspQualityEvaluator(box, 3)
    with pytest.raises(InvalidInputError, match=r"WrenchSpaceDisplayParams\.scale must be .*, not 0"):
        WrenchSpaceDisplay(RecordingMeshcat(), WrenchSpaceDisplayParams(scale=0.0))
    with pytest.raises(InvalidInputError, match=r"^meshcat must be a Meshcat, .*, not None"):
        WrenchSpaceDisplay(None)
    with pytest.raises(UnknownNameError, match=r"GraspQualityParams\.norm must be one of L1, Linf.*, not 'L2'"):
        GraspQualityEvaluator(box, GraspQualityParams(norm="L2"))
    with pytest.raises(PortTypeError, match="'hypotheses' of system"):
        evaluate(GraspQualityEvaluator(box), hypotheses=Contacts.empty())
