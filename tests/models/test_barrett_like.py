"""The Barrett-like hand: the published figures, its soft pads, and what they feel when it holds something."""

import dataclasses
import sys
from typing import Any

import numpy as np
import pytest
from pydrake.geometry import (
    AddContactMaterial,
    AddRigidHydroelasticProperties,
    Box,
    ProximityProperties,
)
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlant, CoulombFriction, MultibodyPlant, MultibodyPlantConfig
from pydrake.multibody.tree import RevoluteJoint, SpatialInertia, default_model_instance
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from tactopose_drake.core.sensing.tactile_array import TactileModel
from tactopose_drake.core.sensing.tactile_layout import TactileLayout
from tactopose_drake.core.sensing.tactile_patterns import CellRow, RowPattern
from tactopose_drake.errors import InvalidInputError, UnknownNameError
from tactopose_drake.hand.hand_config import load_hand_config
from tactopose_drake.hand.hand_in_plant import Hand, add_hand, make_hand_plant
from tactopose_drake.hand.joint_matrices import joint_matrix
from tactopose_drake.hand.tactile_pads import TactilePad, load_tactile_pad
from tactopose_drake.resources import model_path
from tactopose_drake.systems.simulated_array import TactileArray

FINGERS = ("finger_1", "finger_2", "finger_3")
FOLDER = model_path("hands", "barrett_like")


@pytest.fixture(scope="module")
def hand_plant() -> tuple[MultibodyPlant, Hand]:
    return make_hand_plant(load_hand_config("barrett_like"))


@pytest.fixture(scope="module")
def generator() -> dict[str, Any]:
    """What generate.py defines."""
    namespace: dict[str, Any] = {"__name__": "generate", "__file__": str(FOLDER / "generate.py")}
    before = list(sys.path)
    exec(compile((FOLDER / "generate.py").read_text(), "generate.py", "exec"), namespace)
    sys.path[:] = before
    return namespace


def test_the_files_are_what_the_generator_writes(generator: dict[str, Any]) -> None:
    files = generator["pad_files"]() | {"barrett_like.sdf": generator["model_text"]()}
    for name, text in files.items():
        assert text == (FOLDER / name).read_text(), name


def test_eight_joints_four_motors_and_the_published_ranges(hand_plant: tuple[MultibodyPlant, Hand]) -> None:
    plant, hand = hand_plant
    assert plant.num_positions() == 8
    assert plant.num_actuators() == 4
    ranges = {
        joint.name(): np.degrees([joint.position_lower_limits()[0], joint.position_upper_limits()[0]])
        for joint in (plant.get_joint(i) for i in plant.GetJointIndices(hand.model_instance))
        if isinstance(joint, RevoluteJoint)
    }
    for name, (low, high) in ranges.items():
        assert low == 0
        expected = 180 if "spread" in name else 140 if "proximal" in name else 140 / 3
        assert high == pytest.approx(expected, abs=1e-5)
    context = plant.CreateDefaultContext()
    bodies = [plant.get_body(i) for i in plant.GetBodyIndices(hand.model_instance)]
    assert sum(body.get_mass(context) for body in bodies) == pytest.approx(0.98)
    assert all(body.CalcSpatialInertiaInBodyFrame(context).IsPhysicallyValid() for body in bodies)


def set_posture(plant: MultibodyPlant, hand: Hand, context: Any, spread: float, proximal: dict[str, float]) -> None:
    """Sets the motors' joints, and those that follow as the hand's description says."""
    plant.GetJointByName("finger_1_spread_joint").set_angle(context, spread)
    for finger, angle in proximal.items():
        plant.GetJointByName(f"{finger}_proximal_joint").set_angle(context, angle)
    for coupling in (c for finger in hand.config.fingers for c in finger.couplings):
        leader = plant.GetJointByName(coupling.follows).get_angle(context)
        plant.GetJointByName(coupling.joint).set_angle(context, coupling.ratio * leader)


@pytest.mark.parametrize("spread", [0.0, 0.7, np.pi])
@pytest.mark.parametrize("angle", [0.0, 1.3, 2.44])
def test_the_fingers_stand_where_the_published_kinematics_put_them(
    hand_plant: tuple[MultibodyPlant, Hand], spread: float, angle: float
) -> None:
    """A finger is planar: 50 mm out, 70 mm at Phi_2 = 2.46 deg, the distal link bent by Phi_3 = 42 deg more."""
    plant, hand = hand_plant
    context = plant.CreateDefaultContext()
    set_posture(plant, hand, context, spread, dict.fromkeys(FINGERS, angle))
    first, second = angle + np.radians(2.46), angle + angle / 3 + np.radians(2.46 + 42)
    roots = {"finger_1": ([0.025, 0], spread), "finger_2": ([-0.025, 0], -spread), "finger_3": ([0, 0], np.pi)}
    for finger, (root, turn) in roots.items():
        outwards = np.array([np.sin(turn), np.cos(turn), 0.0])
        X_PT = plant.CalcRelativeTransform(context, hand.palm_frame, hand.pad_frames[finger])
        joint = [*root, 0.0754] + (0.05 + 0.07 * np.cos(first)) * outwards + [0, 0, 0.07 * np.sin(first)]
        np.testing.assert_allclose(X_PT.translation(), joint, atol=1e-8)
        along = np.cos(second) * outwards + [0, 0, np.sin(second)]
        out_of_pad = -np.sin(second) * outwards + [0, 0, np.cos(second)]
        np.testing.assert_allclose(X_PT.rotation().matrix()[:, 0], along, atol=1e-8)
        np.testing.assert_allclose(-X_PT.rotation().matrix()[:, 1], out_of_pad, atol=1e-8)


def test_measured_joints_become_the_plants_positions(hand_plant: tuple[MultibodyPlant, Hand]) -> None:
    plant, hand = hand_plant
    inner, outer = ([f"finger_{i}_{part}_joint" for i in (1, 2, 3)] for part in ("proximal", "distal"))
    seven = [*inner, *outer, "finger_1_spread_joint"]  # the order in which the real hand's driver gives them
    values = np.array([0.5, 0.6, 0.7, 0.25, 0.3, 0.35, 0.9])
    q = joint_matrix(plant, hand, seven) @ values
    for name, value in zip([*seven, "finger_2_spread_joint"], [*values, 0.9], strict=True):
        assert q[plant.GetJointByName(name).position_start()] == value
    # Without the outer joints, they follow the inner ones.
    q = joint_matrix(plant, hand, [*inner, "finger_1_spread_joint"]) @ values[[0, 1, 2, 6]]
    for i in (1, 2, 3):
        measured, follows = (
            plant.GetJointByName(f"finger_{i}_{k}_joint").position_start() for k in ("proximal", "distal")
        )
        assert q[follows] == pytest.approx(q[measured] / 3)


def test_measured_joints_must_tell_every_position(hand_plant: tuple[MultibodyPlant, Hand]) -> None:
    with pytest.raises(UnknownNameError, match=r"must be one of finger_1_distal_joint.*, not 'F1_inner'"):
        joint_matrix(*hand_plant, ["F1_inner"])
    with pytest.raises(InvalidInputError, match="must have 'finger_1_spread_joint'"):
        joint_matrix(*hand_plant, [f"finger_{i}_proximal_joint" for i in (1, 2, 3)])
    with pytest.raises(InvalidInputError, match="measured must be different joints, not"):
        joint_matrix(*hand_plant, ["finger_1_spread_joint"] * 2)


def test_the_cells_lie_on_the_pads_faces(generator: dict[str, Any]) -> None:
    outline = generator["pad_outline"]()
    edges = np.roll(outline, -1, axis=0) - outline
    outward = np.column_stack([edges[:, 1], -edges[:, 0]]) / np.linalg.norm(edges, axis=1)[:, None]
    corners = load_tactile_pad("bh280_finger").layout.corners
    height = np.einsum("mcki,ki->mck", corners[:, :, None, :2] - outline, outward).max(axis=2)
    np.testing.assert_allclose(height, 0.0, atol=2e-5)
    # Below the cells, no depth up to 1.9 mm is nearer to the pad's side than to its face.
    assert np.abs(corners[..., 2]).max() + 0.0019 < generator["PAD_HALF_WIDTH"]


def test_the_skin_is_a_mesh_without_gaps_or_overlaps(generator: dict[str, Any]) -> None:
    outline, skin, width = generator["pad_outline"](), generator["SKIN"], generator["PAD_HALF_WIDTH"]
    vertices, tetrahedra = generator["soft_prism"](outline, width, skin)
    a, b, c, d = vertices[tetrahedra].transpose(1, 0, 2)
    volume = np.einsum("ti,ti->t", np.cross(b - a, c - a), d - a) / 6
    assert volume.min() > 0
    x, y = outline.T
    area = 0.5 * np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))
    assert volume.sum() == pytest.approx(area * 2 * width, rel=1e-12)
    faces = np.sort(tetrahedra[:, [[0, 1, 2], [0, 1, 3], [0, 2, 3], [1, 2, 3]]].reshape(-1, 3), axis=1)
    unique, count = np.unique(faces, axis=0, return_counts=True)
    assert count.max() == 2
    # Only the outer surface has faces that belong to one tetrahedron, so Drake counts depth from there.
    assert unique[count == 1].max() < 2 * len(outline)


def whole_pad(generator: dict[str, Any]) -> TactilePad:
    """Ideal cells without gaps, one for each face of a fingertip's palm side."""
    outline, width = generator["pad_outline"](), generator["PAD_HALF_WIDTH"]
    edges = np.diff(outline, axis=0)
    normals = np.column_stack([edges[:, 1], -edges[:, 0]]) / np.linalg.norm(edges, axis=1)[:, None]
    rays = normals + np.concatenate([normals[:1], normals[:-1]])
    corners, directions = [], []
    for i in range(len(outline) - len(generator["PAD_BACK"]) - 1):
        places = ((i, -width), (i + 1, -width), (i + 1, width), (i, width))
        corners.append([[*outline[k], z] for k, z in places])
        directions.append([[*rays[k], 0.0] for k, _ in places])
    return TactilePad(TactileLayout(np.array(corners), np.array(directions)), TactileModel(), period=0.01)


def whole_palm() -> TactilePad:
    rows = [CellRow(center=[0, float(y), 0.0775], count=21, cell=[0.005, 0.004]) for y in 0.005 * (4.5 - np.arange(10))]
    pattern = RowPattern(along=[0, -1, 0], normal=[0, 0, 1], pitch=0.004, rows=rows)
    return TactilePad(pattern.make(), TactileModel(), period=0.01)


@dataclasses.dataclass
class Held:
    """By pad: what its array reads, Pa; its cells' normals; and the simulator's force of the box on it, in W, N."""

    pressure: dict[str, np.ndarray]
    n_W: dict[str, np.ndarray]
    force: dict[str, np.ndarray]


def hold_box(
    pads: dict[str, TactilePad],
    size: list[float],
    X_WBox: RigidTransform,
    torque: dict[str, float],
    *,
    mass: float | None,
    friction: float = 0.9,
) -> Held:
    """The hand, palm up, with torques on proximal joints, N m, and a box of some mass, kg, or fixed in the world."""
    builder = DiagramBuilder()
    config = MultibodyPlantConfig(time_step=0.002, contact_model="hydroelastic")
    plant, scene_graph = AddMultibodyPlant(config, builder)
    hand = add_hand(plant, load_hand_config("barrett_like"), RigidTransform())
    body = plant.AddRigidBody("box", default_model_instance(), SpatialInertia.SolidBoxWithMass(mass or 1.0, *size))
    properties = ProximityProperties()
    AddContactMaterial(dissipation=5.0, friction=CoulombFriction(friction, friction), properties=properties)
    AddRigidHydroelasticProperties(0.01, properties)
    plant.RegisterCollisionGeometry(body, RigidTransform(), Box(*size), "box", properties)
    if mass is None:
        plant.WeldFrames(plant.world_frame(), body.body_frame(), X_WBox)
    plant.Finalize()
    for name, pad in pads.items():
        array = builder.AddNamedSystem(name, TactileArray(plant, hand.pad_frames[name], pad))
        builder.Connect(plant.get_contact_results_output_port(), array.GetInputPort("contact_results"))
        builder.Connect(plant.get_body_poses_output_port(), array.GetInputPort("body_poses"))
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    plant_context = plant.GetMyMutableContextFromRoot(context)
    set_posture(plant, hand, plant_context, 0.0, {finger: 0.9 if finger in torque else 0.0 for finger in FINGERS})
    if mass is not None:
        plant.SetFreeBodyPose(plant_context, body, X_WBox)
    actuation = np.zeros(4)
    for finger, value in torque.items():
        actuation[plant.GetJointActuatorByName(f"{finger}_proximal_joint").input_start()] = value
    plant.get_actuation_input_port().FixValue(plant_context, actuation)
    simulator = Simulator(diagram, context)
    simulator.AdvanceTo(0.6)
    return read(diagram, plant, scene_graph, hand, context, pads)


def read(diagram: Any, plant: Any, scene_graph: Any, hand: Hand, context: Any, pads: dict[str, TactilePad]) -> Held:
    plant_context = plant.GetMyContextFromRoot(context)
    results = plant.get_contact_results_output_port().Eval(plant_context)
    inspector = scene_graph.model_inspector()
    held = Held({}, {}, {})
    for name in pads:
        array = diagram.GetSubsystemByName(name)
        held.pressure[name] = array.GetOutputPort("pressures").Eval(array.GetMyContextFromRoot(context))
        frame = hand.pad_frames[name]
        held.n_W[name] = pads[name].layout.n_T @ frame.CalcPoseInWorld(plant_context).rotation().matrix().T
        held.force[name] = np.zeros(3)
        for i in range(results.num_hydroelastic_contacts()):
            info = results.hydroelastic_contact_info(i)
            for geometry, sign in ((info.contact_surface().id_M(), 1), (info.contact_surface().id_N(), -1)):
                if plant.GetBodyFromFrameId(inspector.GetFrameId(geometry)).index() == frame.body().index():
                    held.force[name] += sign * info.F_Ac_W().translational()
    return held


def test_a_box_on_the_palm_is_felt_with_all_its_weight() -> None:
    X_WBox, mass = RigidTransform([0.003, -0.002, 0.0775 + 0.025 - 1e-4]), 0.9
    palms = {"without gaps": whole_palm(), "shipped": load_tactile_pad("bh280_palm")}
    felt = {}
    for name, palm in palms.items():
        held = hold_box({"palm": palm}, [0.04, 0.03, 0.05], X_WBox, {}, mass=mass)
        np.testing.assert_allclose(held.force["palm"], [0, 0, -9.81 * mass], atol=0.02)
        felt[name] = held.pressure["palm"] @ palm.layout.areas
    assert felt["without gaps"] == pytest.approx(9.81 * mass, rel=2e-3)
    # The real cells leave gaps: 10 mm of 11, and 9.7 of 10.6.
    assert felt["shipped"] == pytest.approx(9.81 * mass * (10 / 11) * (9.7 / 10.6), rel=0.06)


@pytest.mark.parametrize("shipped", [False, True])
def test_a_finger_feels_the_force_with_which_it_presses(generator: dict[str, Any], shipped: bool) -> None:
    pad = load_tactile_pad("bh280_finger") if shipped else whole_pad(generator)
    # Narrower than the pad: on a pad's sides, where pressure rises sideways, Drake's solver leaves faces out. Without
    # friction, as the box's own sides, sunk into the pad, would rub on it.
    size, X_WBox = [0.012, 0.06, 0.09], RigidTransform([0, 0, 0.145])
    held = hold_box({"finger_3": pad}, size, X_WBox, {"finger_3": 0.6}, mass=None, friction=0.0)
    force, pressure, n_W = held.force["finger_3"], held.pressure["finger_3"], held.n_W["finger_3"]
    assert -force[1] > 3.0
    # The field acts along y, the normal of the box's face; a cell reads its part along the cell's own normal.
    felt = np.sum(pressure * pad.layout.areas / np.abs(n_W[:, 1]))
    if shipped:
        assert 0.7 < felt / -force[1] < 1.0
        assert np.count_nonzero(pressure > 0.05 * pressure.max()) >= 3
    else:
        assert felt == pytest.approx(-force[1], rel=0.01)


def test_opposed_fingers_feel_alike() -> None:
    """Fingers 1 and 2 are each other's mirror image, and finger 3 stands against them."""
    pads = {name: load_tactile_pad("bh280_finger") for name in FINGERS}
    held = hold_box(pads, [0.09, 0.06, 0.09], RigidTransform([0, 0, 0.145]), dict.fromkeys(FINGERS, 0.6), mass=None)
    first, second, third = (held.pressure[finger].reshape(8, 3) for finger in FINGERS)
    largest = first.max()
    assert largest > 5e3
    np.testing.assert_allclose(first, second[:, ::-1], atol=0.03 * largest)
    np.testing.assert_allclose(first.sum(axis=1), third.sum(axis=1), atol=0.05 * largest)
    assert held.force["finger_1"][1] > 1.0
    assert held.force["finger_3"][1] < -1.0
