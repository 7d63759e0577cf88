"""How a simulated world differs from what the estimation is told."""

import dataclasses

import numpy as np
import pytest
from pydrake.geometry import Mesh, ReadObjToTriangleSurfaceMesh, SceneGraph
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.framework import DiagramBuilder

from tactopose_drake.core.vision.depth_pictures import DepthCameraModel
from tactopose_drake.errors import InvalidInputError
from tactopose_drake.hand.hand_config import HandUncertainty, PadConfig, load_hand_config
from tactopose_drake.hand.hand_in_plant import add_hand, make_hand_plant
from tactopose_drake.hand.simulated_fingertip_errors import change_fingertips, move_pads
from tactopose_drake.hand.tactile_pads import load_tactile_pad
from tactopose_drake.resources import add_model, make_parser
from tactopose_drake.station.scenario import Scenario, load_scenario
from tactopose_drake.station.simulated_errors import FingerErrors, PadErrors, SimulatedErrors, hand_errors
from tactopose_drake.station.simulated_senses import simulate_errors
from tactopose_drake.station.simulated_shape_errors import change_object
from tactopose_drake.systems.depth_camera import AddDepthCamera

HAND = "shadow_like"


def test_what_is_drawn_has_the_declared_spread_and_stays_with_its_seed() -> None:
    config = load_hand_config(HAND)
    config.uncertainty = HandUncertainty(encoder_offset_deg=2.0, sensor_force=0.3)
    many = [hand_errors(SimulatedErrors(drawn=True, tared=False, seed=seed), config) for seed in range(60)]
    offsets = np.degrees([list(drawn.offsets.values()) for drawn in many])
    assert np.std(offsets) == pytest.approx(2.0, rel=0.1)
    forces = np.array([bias[3:] for drawn in many for bias in drawn.bias.values()])
    assert np.std(forces) == pytest.approx(0.3, rel=0.1)
    assert np.std([list(drawn.radius.values()) for drawn in many]) == pytest.approx(0.0001, rel=0.15)
    again = hand_errors(SimulatedErrors(drawn=True, tared=False, seed=7), config)
    assert again.offsets == many[7].offsets
    assert many[7].offsets != many[8].offsets


def test_a_tare_leaves_no_bias_and_all_else_as_it_is() -> None:
    config = load_hand_config(HAND)
    fingers = {"thumb": FingerErrors(drift_force=[0.01, 0.0, 0.0]), "first": FingerErrors(sensor_force=[0.0, 0.1, 0.0])}
    tared, not_tared = (
        hand_errors(SimulatedErrors(drawn=True, tared=tared, fingers=fingers), config) for tared in (True, False)
    )
    assert not any(np.any(tared.bias[finger]) for finger in ("thumb", "middle", "ring", "little"))
    assert all(np.all(bias[:3] != 0.0) for bias in not_tared.bias.values())
    # What is given is there after the tare, and drift goes on from it.
    np.testing.assert_array_equal(tared.bias["first"], [0.0, 0.0, 0.0, 0.0, 0.1, 0.0])
    np.testing.assert_array_equal(tared.drift["thumb"], [0.0, 0.0, 0.0, 0.01, 0.0, 0.0])
    assert (tared.offsets, tared.radius) == (not_tared.offsets, not_tared.radius)


def test_what_is_given_takes_the_place_of_what_is_drawn() -> None:
    config = load_hand_config(HAND)
    given = SimulatedErrors(
        drawn=True,
        tared=False,
        joint_offsets_deg={"FFJ3": 2.0},
        fingers={"thumb": FingerErrors(radius=0.001, sensor_force=[0.1, 0.0, 0.0], drift_moment=[0.0, 0.0, 1e-4])},
    )
    found, drawn = hand_errors(given, config), hand_errors(SimulatedErrors(drawn=True, tared=False), config)
    assert np.degrees(found.offsets["FFJ3"]) == pytest.approx(2.0)
    assert found.offsets["THJ4"] == drawn.offsets["THJ4"]
    assert found.radius["thumb"] == 0.001
    np.testing.assert_array_equal(found.bias["thumb"][3:], [0.1, 0.0, 0.0])
    np.testing.assert_array_equal(found.bias["thumb"][:3], drawn.bias["thumb"][:3])
    np.testing.assert_array_equal(found.drift["thumb"], [0.0, 0.0, 1e-4, 0.0, 0.0, 0.0])
    np.testing.assert_array_equal(found.bias["first"], drawn.bias["first"])


def test_by_default_nothing_errs() -> None:
    none = hand_errors(SimulatedErrors(), load_hand_config(HAND))
    assert not any(none.offsets.values())
    assert not any(none.radius.values())
    assert not any(np.any(bias) for bias in none.bias.values())
    assert all(X_SM.IsExactlyIdentity() for X_SM in none.X_SM.values())


@pytest.mark.parametrize(
    ("errors", "said"),
    [
        (SimulatedErrors(joint_offsets_deg={"J9": 1.0}), "joint_offsets_deg must be one of FFJ2.*, not 'J9'"),
        (SimulatedErrors(joint_offsets_deg={"FFJ3": 200.0}), r"joint_offsets_deg\[FFJ3\]"),
        (SimulatedErrors(fingers={"toe": FingerErrors()}), "fingers must be one of first.*, not 'toe'"),
        (SimulatedErrors(fingers={"first": FingerErrors(radius=-0.009)}), "must be a number >= -0.0072 .*, not -0.009"),
        (SimulatedErrors(fingers={"first": FingerErrors(sensor_force=[1.0])}), r"fingers\[first\].sensor_force"),
        (SimulatedErrors(pads={"palm": PadErrors()}), "pads must be left out, .*, not 'palm'"),
        (SimulatedErrors(encoder_noise_deg=-1.0), "encoder_noise_deg"),
        (SimulatedErrors(object_scale=3.0), "object_scale"),
        (SimulatedErrors(object_surface_sigma=-1.0), "object_surface_sigma"),
        (SimulatedErrors(vision_degrees_of_freedom=0.0), "vision_degrees_of_freedom"),
    ],
)
def test_what_cannot_be_is_refused_with_what_is_allowed(errors: SimulatedErrors, said: str) -> None:
    with pytest.raises(InvalidInputError, match=said):
        errors.validate(load_hand_config(HAND))


def test_a_fingertip_may_be_thinner_by_four_fifths_of_its_half_width() -> None:
    for radius in (-0.00719, 0.0, 0.002):
        SimulatedErrors(fingers={"first": FingerErrors(radius=radius)}).validate(load_hand_config(HAND))


def test_a_hand_that_declares_nothing_has_nothing_to_draw_from() -> None:
    with pytest.raises(
        InvalidInputError, match=r"SimulatedErrors\.drawn must be false, not true, as the hand's file declares no"
    ):
        SimulatedErrors(drawn=True).validate(load_hand_config("barrett_like"))


def test_a_scenario_without_errors_takes_its_hand_at_its_word() -> None:
    shipped = load_scenario(HAND)
    assert shipped.errors is not None
    assert shipped.errors.drawn
    perfect = shipped.without_errors()
    assert perfect.errors is None
    assert not perfect.estimation.use_uncertainty
    assert shipped.estimation.use_uncertainty


def shapes(plant: MultibodyPlant, scene_graph: SceneGraph, instance: ModelInstanceIndex):  # type: ignore[no-untyped-def]
    inspector = scene_graph.model_inspector()
    return {
        geometry: (inspector.GetShape(geometry).Clone(), RigidTransform(inspector.GetPoseInFrame(geometry)))
        for body in map(plant.get_body, plant.GetBodyIndices(instance))
        for geometry in plant.GetCollisionGeometriesForBody(body)
    }


def test_a_fingertip_is_thicker_and_elsewhere() -> None:
    plant, scene_graph = AddMultibodyPlantSceneGraph(DiagramBuilder(), 0.001)
    hand = add_hand(plant, load_hand_config(HAND), RigidTransform())
    before = shapes(plant, scene_graph, hand.model_instance)
    radius = dict.fromkeys(hand.sensor_frames, 0.0) | {"thumb": 0.002}
    turned = RigidTransform(RotationMatrix.MakeXRotation(0.1), [0.001, 0.0, 0.0])
    X_SM = dict.fromkeys(hand.sensor_frames, RigidTransform()) | {"first": turned}
    change_fingertips(plant, scene_graph, hand, radius, X_SM)
    after, (alone, parts) = shapes(plant, scene_graph, hand.model_instance), make_hand_plant(hand.config)
    for finger, weld in hand.welds.items():
        (tip,) = plant.GetCollisionGeometriesForBody(weld.child_body())
        assert after[tip][0].radius() == pytest.approx(0.009 + radius[finger])
        tip_body, frame = parts.welds[finger].child_body(), parts.sensor_frames[finger]
        X_BS = alone.CalcRelativeTransform(alone.CreateDefaultContext(), tip_body.body_frame(), frame)
        moved = X_BS @ X_SM[finger] @ X_BS.inverse() @ before[tip][1]
        assert after[tip][1].IsNearlyEqualTo(moved, 1e-12)
    inspector = scene_graph.model_inspector()
    (tip,) = plant.GetCollisionGeometriesForBody(hand.welds["thumb"].child_body())
    assert inspector.GetProximityProperties(tip).HasProperty("material", "coulomb_friction")
    # As before: within this hand nothing collides.
    assert all(inspector.CollisionFiltered(tip, other) for other in before if other != tip)


def test_a_pad_is_elsewhere_with_its_array() -> None:
    config = load_hand_config("barrett_like")
    config.uncertainty = HandUncertainty(encoder_offset_deg=0.0, mounting=0.001, mounting_deg=2.0)
    many = [hand_errors(SimulatedErrors(drawn=True, seed=seed), config).X_TM for seed in range(100)]
    middles = {pad.name: load_tactile_pad(pad.array).layout.p_TC.mean(axis=0) for pad in config.pads}
    moved = [X_TM @ middles[pad] - middles[pad] for drawn in many for pad, X_TM in drawn.items()]
    turned = [RollPitchYaw(X_TM.rotation()).vector() for drawn in many for X_TM in drawn.values()]
    # As the estimation is told, `PadUncertainty`.
    np.testing.assert_allclose(np.std(moved, axis=0), 0.001, rtol=0.15)
    np.testing.assert_allclose(np.degrees(np.std(turned, axis=0)), 2.0, rtol=0.15)
    given = SimulatedErrors(pads={"finger_3": PadErrors(mounting=[0.001, 0.0, 0.0], mounting_deg=[0.0, 6.0, 0.0])})
    X_TM = hand_errors(given, config).X_TM
    assert all(X.IsExactlyIdentity() for pad, X in X_TM.items() if pad != "finger_3")
    plant, scene_graph = AddMultibodyPlantSceneGraph(DiagramBuilder(), 0.001)
    hand = add_hand(plant, config, RigidTransform())
    before = shapes(plant, scene_graph, hand.model_instance)
    move_pads(plant, scene_graph, hand, X_TM)
    after, inspector = shapes(plant, scene_graph, hand.model_instance), scene_graph.model_inspector()
    X_BT = hand.pad_frames["finger_3"].GetFixedPoseInBodyFrame()
    own = plant.GetCollisionGeometriesForBody(hand.pad_frames["finger_3"].body())
    assert own
    for geometry, (_, X_BG) in before.items():
        expected = X_BT @ X_TM["finger_3"] @ X_BT.inverse() @ X_BG if geometry in own else X_BG
        assert after[geometry][1].IsNearlyEqualTo(expected, 1e-12)
    assert all(inspector.CollisionFiltered(own[0], other) for other in before if other not in own)


def test_two_senses_on_one_body_cannot_be_mounted_apart() -> None:
    config = load_hand_config(HAND)
    config.pads = [PadConfig(name="skin", frame="first_tip", array="bh280_finger", alpha=2e-8)]
    scenario = dataclasses.replace(load_scenario(HAND), errors=SimulatedErrors(drawn=True))
    plant, scene_graph = AddMultibodyPlantSceneGraph(DiagramBuilder(), 0.001)
    hand = add_hand(plant, config, RigidTransform())
    with pytest.raises(
        InvalidInputError, match="must have no mounting error of the two sensors of first_tip, which cannot move apart"
    ):
        simulate_errors(scenario, plant, scene_graph, hand, hand.model_instance)
    there = {"mounting": [0.0] * 3, "mounting_deg": [0.0] * 3}
    given = SimulatedErrors(drawn=True, fingers={"first": FingerErrors(**there)}, pads={"skin": PadErrors(**there)})
    offset = SimulatedErrors(joint_offsets_deg={config.finger("first").joints[0]: 1.0})
    for errors in (offset, given):
        plant, scene_graph = AddMultibodyPlantSceneGraph(DiagramBuilder(), 0.001)
        hand = add_hand(plant, config, RigidTransform())
        simulate_errors(
            dataclasses.replace(scenario, errors=errors), plant, scene_graph, hand, hand.model_instance
        )  # mounted where they are told to be
    config.pads[0].frame = config.finger("first").sensor_frame
    plant, scene_graph = AddMultibodyPlantSceneGraph(DiagramBuilder(), 0.001)
    hand = add_hand(plant, config, RigidTransform())
    simulate_errors(scenario, plant, scene_graph, hand, hand.model_instance)  # on another link than the fingertip


def test_an_object_is_larger_about_its_centre_of_mass_with_bumps() -> None:
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, 0.001)
    scenario = Scenario(object="mug")
    instance = add_model(make_parser(plant), scenario.object_sdf())
    middle = plant.get_body(plant.GetBodyIndices(instance)[0]).default_spatial_inertia().get_com()
    before = np.array(ReadObjToTriangleSurfaceMesh(str(scenario.object_mesh())).vertices())
    change_object(plant, scene_graph, instance, 1.1, 0.0, np.random.default_rng(0))
    ((shape, _),) = shapes(plant, scene_graph, instance).values()
    assert isinstance(shape, Mesh)
    np.testing.assert_allclose(vertices(shape), middle + 1.1 * (before - middle), atol=1e-7)
    # A camera sees what is held.
    (seen,) = plant.GetVisualGeometriesForBody(plant.get_body(plant.GetBodyIndices(instance)[0]))
    np.testing.assert_array_equal(vertices(scene_graph.model_inspector().GetShape(seen)), vertices(shape))
    AddDepthCamera(builder, scene_graph, RigidTransform(), DepthCameraModel())  # Its renderer takes the mesh.

    squares = []
    for seed in range(6):
        plant, scene_graph = AddMultibodyPlantSceneGraph(DiagramBuilder(), 0.001)
        instance = add_model(make_parser(plant), scenario.object_sdf())
        change_object(plant, scene_graph, instance, 1.0, 0.001, np.random.default_rng(seed))
        ((shape, _),) = shapes(plant, scene_graph, instance).values()
        squares.append(np.sum((vertices(shape) - before) ** 2, axis=1).mean())
    assert np.sqrt(np.mean(squares)) == pytest.approx(0.001, rel=0.15)


def vertices(shape: Mesh) -> np.ndarray:
    text = shape.source().in_memory().mesh_file.contents().decode()
    rows = [line.split()[1:] for line in text.splitlines() if line.startswith("v ")]
    return np.array(rows, dtype=np.float64)


def test_an_object_that_is_no_mesh_cannot_have_another_shape() -> None:
    plant, scene_graph = AddMultibodyPlantSceneGraph(DiagramBuilder(), 0.001)
    hand = add_hand(plant, load_hand_config(HAND), RigidTransform())
    with pytest.raises(
        InvalidInputError, match=r"object_surface_sigma: the collision shape of .* must be the mesh of an OBJ file, not"
    ):
        change_object(plant, scene_graph, hand.model_instance, 1.1, 0.0, np.random.default_rng(0))
