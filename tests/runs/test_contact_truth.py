import itertools

import numpy as np
import pytest
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlantConfig
from pydrake.systems.framework import DiagramBuilder

from tactopose_drake.hand.hand_config import load_hand_config
from tactopose_drake.hand.hand_in_plant import add_hand
from tactopose_drake.resources import make_parser, model_path
from tactopose_drake.runs.contact_truth import ContactTruth, PartContact, _joined, contact_truth

DEPTH = 2e-4  # m
HALF = 0.03  # of the cube, m
P_OFF = 1e-4  # m, from the fingertip's middle to the seam between two shapes


def truth_with_cube(
    p_WO: np.ndarray, *, object_first: bool = False, representation: str = "polygon", cube: str = ""
) -> ContactTruth:
    """The straight hand, and the cube, or another of an SDF's text, upright, with its bottom's centre at p_WO."""
    builder = DiagramBuilder()
    config = MultibodyPlantConfig(
        time_step=0.001,
        contact_model="hydroelastic",
        use_sampled_output_ports=False,
        contact_surface_representation=representation,
    )
    plant, _ = AddMultibodyPlant(config=config, builder=builder)
    # The order decides which of the two Drake calls M.
    for add_object in (object_first, not object_first):
        if add_object:
            parser = make_parser(plant)
            path = model_path("objects", "cube.sdf")
            (instance,) = parser.AddModelsFromString(cube, "sdf") if cube else parser.AddModels(str(path))
        else:
            hand = add_hand(plant, load_hand_config("shadow_like"), RigidTransform())
    plant.Finalize()
    diagram = builder.Build()
    plant_context = plant.GetMyMutableContextFromRoot(diagram.CreateDefaultContext())
    body = plant.get_body(plant.GetBodyIndices(instance)[0])
    plant.SetFreeBodyPose(plant_context, body, RigidTransform(p_WO))
    return contact_truth(plant, plant_context, hand, body)


# Where the very end of the straight first finger is, m, in the palm; the palm is 34 mm above the base.
P_END = np.array([0.033, 0.0, 0.095 + 0.045 + 0.025 + 0.012 + 0.014 + 0.009])
P_PALM_W = np.array([0.0, 0.0, 0.034])


@pytest.mark.parametrize("object_first", [False, True])
@pytest.mark.parametrize("representation", ["polygon", "triangle"])
def test_a_fingertip_pressed_into_a_flat(object_first, representation):
    # To the thumb's side, so that the longer middle finger stays free.
    p_WO = P_PALM_W + P_END + [0.025, 0.0, -DEPTH]
    truth = truth_with_cube(p_WO, object_first=object_first, representation=representation)
    assert set(truth.tips) == {"first"}
    assert truth.other_contacts == ()
    tip = truth.tips["first"]
    # The cube is above: its outward normal is down, and so is its force on the fingertip.
    np.testing.assert_allclose(tip.n_PC, [0, 0, -1], atol=1e-3)
    # A true sphere would carry pi E d^2 = 5 N; the simulator's is a polyhedron inside it.
    assert -5.0 < tip.f_PC[2] < -1.0
    np.testing.assert_allclose(tip.p_PC, P_END - [0, 0, DEPTH], atol=1e-4)
    # The flat cuts a disc out of the sphere.
    assert tip.area == pytest.approx(np.pi * 2 * 0.009 * DEPTH, rel=0.25)


def cube_of_slabs(*edges: float) -> str:
    """A cube's SDF, cut across x at these places, m, into slabs that are collision shapes of their own."""
    slabs = "".join(
        f"""
        <collision name="slab_{i}"><pose>{0.5 * (a + b)} 0 {HALF} 0 0 0</pose>
          <geometry><box><size>{b - a} {2 * HALF} {2 * HALF}</size></box></geometry>
          <drake:proximity_properties><drake:rigid_hydroelastic/></drake:proximity_properties>
        </collision>"""
        for i, (a, b) in enumerate(itertools.pairwise((-HALF, *edges, HALF)))
    )
    moments = "".join(f"<{name}>6e-5</{name}>" for name in ("ixx", "iyy", "izz"))
    products = "".join(f"<{name}>0</{name}>" for name in ("ixy", "ixz", "iyz"))
    return f"""<sdf version="1.7" xmlns:drake="http://drake.mit.edu"><model name="cube"><link name="cube">
        <inertial><mass>0.1</mass><inertia>{moments}{products}</inertia></inertial>{slabs}
    </link></model></sdf>"""


def test_several_shapes_under_one_fingertip_are_one_contact():
    whole, halves = (
        truth_with_cube(P_PALM_W + P_END - [0.0, 0.0, DEPTH], cube=cube_of_slabs(*edges)) for edges in ((), (P_OFF,))
    )
    assert set(whole.tips) == set(halves.tips)
    one, both = whole.tips["first"], halves.tips["first"]
    assert both.area == pytest.approx(one.area, rel=0.15)  # Each is of facets of its own.
    np.testing.assert_allclose(both.f_PC, one.f_PC, atol=0.15)
    assert both.f_PC[2] < -0.5
    np.testing.assert_allclose(both.p_PC, one.p_PC, atol=1e-4)
    np.testing.assert_allclose(both.n_PC, [0.0, 0.0, -1.0], atol=0.02)


def test_of_several_shapes_each_counts_by_its_normal_force():
    n = np.array([0.0, 0.0, -1.0])
    strong = PartContact(np.array([0.01, 0.0, 0.1]), n, np.array([0.5, 0.0, -3.0]), 2e-5)
    weak = PartContact(np.array([0.0, 0.02, 0.1]), np.array([0.0, 0.6, -0.8]), np.array([0.0, 0.6, -0.8]), 1e-5)
    joined = _joined([strong, weak])
    np.testing.assert_allclose(joined.p_PC, [0.0075, 0.005, 0.1])
    np.testing.assert_allclose(joined.f_PC, [0.5, 0.6, -3.8])
    np.testing.assert_allclose(joined.n_PC, np.array([0.0, 0.6, -3.8]) / np.hypot(0.6, 3.8))
    assert joined.area == pytest.approx(3e-5)


def test_other_links_are_named():
    # Against the palm's flat, 11 mm in front of its middle, on the little finger's side.
    truth = truth_with_cube(P_PALM_W + np.array([-0.04, -0.011 - HALF + DEPTH, 0.02]))
    assert set(truth.other_contacts) == {"palm"}
    assert truth.tips == {}
